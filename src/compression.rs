//! Zstandard around any file: read if the content is compressed, written if the name ends in `.zst`.

use std::io::{self, Read, Write};
use std::path::{Path, PathBuf};

/// The extension of compressed files.
const EXTENSION: &str = "zst";

/// The level that files are written with: the library's own default, so that size and speed are what people expect.
const LEVEL: i32 = 3;

/// A compressed file may expand to this many bytes whatever its size ...
const EXPANDS_ALWAYS: u64 = 256 << 20;

/// ... and beyond that to this many times its size. Tables of numbers compress to a tenth at best; only a bomb does better by far.
const EXPANDS_TIMES: u64 = 100;

/// True if the name says that the file is compressed.
pub fn is_named(path: &Path) -> bool {
    path.extension().is_some_and(|e| e.eq_ignore_ascii_case(EXTENSION))
}

/// The name without `.zst`: that of the take inside.
pub fn inner_name(path: &Path) -> PathBuf {
    if is_named(path) { path.with_extension("") } else { path.to_owned() }
}

/// True if the bytes are compressed: a frame of Zstandard, or a skippable one before it.
pub fn is_compressed(bytes: &[u8]) -> bool {
    matches!(bytes, [0x28, 0xb5, 0x2f, 0xfd, ..] | [0x50..=0x5f, 0x2a, 0x4d, 0x18, ..])
}

/// How many bytes a compressed file of this size may expand to.
pub fn limit(compressed: u64) -> u64 {
    compressed.saturating_mul(EXPANDS_TIMES).clamp(EXPANDS_ALWAYS, formats::LARGEST_FILE)
}

/// The bytes that were compressed. Several frames one after the other are one file.
///
/// # Errors
/// The text says what is wrong: damaged, cut off, or larger than [`limit`].
pub fn expand(bytes: &[u8]) -> Result<Vec<u8>, String> {
    let limit = limit(bytes.len() as u64);
    let broken = |e: io::Error| format!("the compressed content is damaged or cut off ({e}); copy or export it again");
    let mut expanded = Vec::new();
    let decoder = zstd::stream::read::Decoder::with_buffer(bytes).map_err(broken)?;
    decoder.take(limit.saturating_add(1)).read_to_end(&mut expanded).map_err(broken)?;
    if expanded.len() as u64 > limit {
        return Err(format!(
            "its {} compressed bytes expand to more than {limit}, which no take does; if it is one, expand it with zstd -d first",
            bytes.len()
        ));
    }
    Ok(expanded)
}

/// Calls `write` with `out`, or with something that compresses into `out` if `compressed` says so. The same bytes give the same file.
///
/// # Errors
/// Those of `write`, and I/O errors as `io_error` makes them.
pub fn through<E>(
    out: &mut dyn Write,
    compressed: bool,
    io_error: impl Fn(io::Error) -> E,
    write: impl FnOnce(&mut dyn Write) -> Result<(), E>,
) -> Result<(), E> {
    if !compressed {
        return write(out);
    }
    let mut encoder = zstd::stream::write::Encoder::new(out, LEVEL).map_err(&io_error)?;
    encoder.include_checksum(true).map_err(&io_error)?; // whoever expands it notices damage
    write(&mut encoder)?;
    encoder.finish().map(|_| ()).map_err(io_error)
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;

    fn compressed(bytes: &[u8]) -> Vec<u8> {
        let mut out = Vec::new();
        through(&mut out, true, |e| e, |w| w.write_all(bytes)).unwrap();
        out
    }

    #[test]
    fn what_is_compressed_comes_back() {
        let bytes: Vec<u8> = (0..100_000_u32).map(|i| (i.wrapping_mul(i) >> 7) as u8).collect();
        let small = compressed(&bytes);
        assert!(is_compressed(&small) && !is_compressed(&bytes) && small.len() < bytes.len());
        assert_eq!(expand(&small).unwrap(), bytes);
        assert_eq!(small, compressed(&bytes));
        assert_eq!(expand(&[small.clone(), small.clone()].concat()).unwrap().len(), 200_000, "two frames are one file");
    }

    #[test]
    fn cuts_and_damage_are_noticed() {
        let small = compressed(&(0..50_000_u32).flat_map(|i| (i.wrapping_mul(2_654_435_761) >> 20).to_le_bytes()).collect::<Vec<_>>());
        for length in [4, 5, 9, small.len() / 2, small.len() - 1] {
            assert!(expand(&small[..length]).unwrap_err().contains("damaged or cut off"), "{length}");
        }
        for at in (8..small.len()).step_by(997) {
            let mut damaged = small.clone();
            damaged[at] ^= 0x10;
            assert!(expand(&damaged).is_err(), "{at}");
        }
    }

    #[test]
    fn bombs_do_not_go_off() {
        assert_eq!((limit(10), limit(1 << 30)), (256 << 20, formats::LARGEST_FILE));
        let bomb = compressed(&vec![0; (256 << 20) + 1]);
        assert!(bomb.len() < 100_000);
        assert!(expand(&bomb).unwrap_err().contains("expand to more than 268435456"));
    }

    #[test]
    fn names() {
        for (path, inner, named) in [("a.c3d.zst", "a.c3d", true), ("b/a.csv.ZST", "b/a.csv", true), ("a.c3d", "a.c3d", false)] {
            assert_eq!((inner_name(Path::new(path)), is_named(Path::new(path))), (PathBuf::from(inner), named));
        }
    }
}
