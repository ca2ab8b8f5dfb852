//! Turns the message definitions in `proto/` into Rust types, and into the descriptors that every log carries.
//!
//! It all happens in Rust: building needs no protobuf compiler and no network.
//! A definition is named after its one message; its descriptor set holds the file and everything it imports, and nothing else.
#![allow(clippy::print_stdout)] // this is how a build script talks to cargo

use std::path::{Path, PathBuf};

const ROOT: &str = "proto";

/// Our own messages, and those of Foxglove that viewers know how to draw.
const PACKAGES: [&str; 2] = ["mocap_repair", "foxglove"];

fn main() -> Result<(), Box<dyn std::error::Error>> {
    println!("cargo::rerun-if-changed={ROOT}");
    println!("cargo::rerun-if-changed=build.rs");
    let out = PathBuf::from(std::env::var_os("OUT_DIR").ok_or("OUT_DIR is not set; run this through cargo")?);

    let mut files = Vec::new();
    for package in PACKAGES {
        for entry in std::fs::read_dir(Path::new(ROOT).join(package))? {
            let path = entry?.path();
            if path.extension().is_some_and(|e| e == "proto") {
                files.push(path);
            }
        }
    }
    files.sort(); // the order in which a folder lists its files is nobody's promise

    for file in &files {
        let name = file.file_stem().and_then(|s| s.to_str()).ok_or("a definition needs a name in UTF-8")?;
        let mut compiler = protox::Compiler::new([ROOT])?;
        // Comments stay in the definitions: to decode a message, a reader needs only the types.
        compiler.include_imports(true).include_source_info(false).open_file(file)?;
        std::fs::write(out.join(format!("{name}.binpb")), compiler.encode_file_descriptor_set())?;
    }

    let all = protox::compile(&files, [ROOT])?;
    prost_build::Config::new().out_dir(&out).compile_fds(all)?;
    Ok(())
}
