//! From sources to the file of a plan.

use super::naming::Names;
use super::plan::{Header, OptionFile, PlannedTake, Wanted};
use super::sources::{Findings, Found, hashes, is_address, is_take};
use super::{BatchError, OWN_FOLDER};
use crate::input::hex;
use crate::report::lines;
use crate::staging;
use sha2::{Digest, Sha256};
use std::collections::BTreeSet;
use std::io::{BufWriter, Write};
use std::path::{Path, PathBuf};

/// How the takes of a batch are repaired.
#[derive(Clone, Debug, Default)]
pub struct Way {
    /// The options that shape the result, without folders, so that it does not matter where files lie: what the key is made from.
    pub effective: String,
    /// The options, with full names of files: what takes are run with.
    pub config: String,
    /// The files that options name.
    pub files: Vec<PathBuf>,
    /// What is written beside each repaired take.
    pub wanted: Wanted,
}

impl Way {
    /// The files that options name, and the SHA-256 of these and of the options that shape the result.
    ///
    /// # Errors
    /// One of these cannot be read.
    pub fn settle(&self) -> Result<(Vec<OptionFile>, String), BatchError> {
        let files = self.files.iter().cloned().map(OptionFile::read).collect::<Result<Vec<_>, _>>()?;
        let sha256 = sha256_of(&self.effective, &files);
        Ok((files, sha256))
    }
}

/// SHA-256 of the options that shape the result, and of the files that they name.
pub fn sha256_of(effective: &str, files: &[OptionFile]) -> String {
    let mut hasher = Sha256::new();
    hasher.update(effective);
    for file in files {
        hasher.update(format!("\0{}", file.sha256));
    }
    hex(&hasher.finalize())
}

/// What was planned, for those who are told.
#[derive(Clone, Debug)]
pub struct Planned {
    /// What holds for all takes.
    pub header: Header,
    /// Takes whose outputs got other names, with these.
    pub renamed: Vec<(String, String)>,
    /// Takes that cannot even be tried.
    pub problems: Vec<PlannedTake>,
    /// Takes that cannot be read at the moment.
    pub unread: Vec<String>,
    /// Takes that have the same content as another one.
    pub copies: u64,
}

/// Plans what was found and writes it.
///
/// # Errors
/// Nothing was found, or the plan cannot be written.
pub fn plan(findings: &Findings, sources: &[String], way: &Way, path: &Path, force: bool) -> Result<Planned, BatchError> {
    if findings.takes.is_empty() {
        let known: BTreeSet<String> = formats::ALL.iter().flat_map(|f| f.info().extensions).map(|e| format!(".{e}")).collect();
        let known = known.into_iter().collect::<Vec<_>>().join(", ");
        let text = format!("no takes in {}; takes end in {known}", sources.join(", "));
        if let Some(output) = findings.outputs.first() {
            let output = output.display();
            let because = format!("a batch was run into it ({OWN_FOLDER} lies there: remove that if it is none)");
            return Err(BatchError { text: format!("{text}; {output} was left out, because {because}"), again: false });
        }
        return Err(BatchError { text, again: false });
    }
    if is_take(path) {
        return Err(BatchError::at(path, "is the name of a take; a plan ends in .jsonl"));
    }
    if staging::is_there(path) && !force {
        return Err(BatchError::at(path, "exists already; give another name, or say --force to replace it"));
    }
    let (files, config_sha256) = way.settle()?;
    let mut names = Names::default();
    let mut takes: Vec<PlannedTake> =
        findings.takes.iter().zip(hashes(&findings.takes)).map(|(found, sha256)| planned(found, sha256, &mut names)).collect();
    let mut contents: Vec<&str> = takes.iter().filter_map(|take| take.sha256.as_deref()).collect();
    contents.sort_unstable();
    let copies = contents.windows(2).filter(|pair| pair[0] == pair[1]).count() as u64;
    let header = Header {
        version: env!("CARGO_PKG_VERSION").to_owned(),
        config: way.config.clone(),
        config_sha256,
        files,
        wanted: way.wanted,
        sources: sources.to_vec(),
        takes: takes.len() as u64,
        bytes: takes.iter().map(|take| take.bytes).sum(),
    };
    let renamed = takes.iter().filter(|take| take.output != take.path).map(|take| (take.path.clone(), take.output.clone())).collect();
    let unread = takes.iter().filter(|take| take.sha256.is_none() && take.problem.is_none() && !is_address(&take.source));
    let unread = unread.map(|take| take.path.clone()).collect();
    let problems = takes.iter().filter(|take| take.problem.is_some()).cloned().collect();
    // the largest first: whoever comes last is done soon
    takes.sort_by(|a, b| b.bytes.cmp(&a.bytes).then_with(|| a.path.cmp(&b.path)));
    let unwritable = |e: std::io::Error| BatchError::io(path, "cannot be written", &e);
    let mut file = staging::beside(path).map_err(unwritable)?;
    {
        let mut out = BufWriter::new(file.as_file_mut());
        out.write_all(lines(std::slice::from_ref(&header)).as_bytes()).map_err(unwritable)?;
        for take in &takes {
            out.write_all(lines(std::slice::from_ref(take)).as_bytes()).map_err(unwritable)?;
        }
        out.flush().map_err(unwritable)?;
    }
    staging::publish(file, path).map_err(unwritable)?;
    Ok(Planned { header, renamed, problems, unread, copies })
}

/// A take as it stands in a plan.
pub fn planned(found: &Found, sha256: Option<String>, names: &mut Names) -> PlannedTake {
    PlannedTake {
        path: found.path.clone(),
        source: found.source.clone(),
        output: names.claim(&found.path),
        bytes: found.bytes,
        modified_ns: found.modified_ns,
        sha256,
        version: found.version.clone(),
        problem: found.problem.clone(),
    }
}
