//! From one format to another, in other units and axes if asked for; each thing that is lost is a note.

use crate::compression;
use crate::input::{Opened, Reading, open};
use crate::output::{self, Names, Way, Written};
use crate::repair::RepairError;
use crate::report::{count, lines, short};
use crate::staging;
use crate::typeset::Style;
use formats::{Direction, Format, Note, Notes, Role, Take, Unit};
use serde::Serialize;
use std::path::{Path, PathBuf};

/// What is wanted.
#[derive(Clone)]
pub struct Conversion {
    /// The take to read. Never written.
    pub input: PathBuf,
    /// The file to write.
    pub output: PathBuf,
    /// What the user states about the input.
    pub reading: Reading,
    /// The axis that points up in the input, if the user states it.
    pub from_up: Option<Direction>,
    /// The format to write; by the output's extension if `None`.
    pub to: Option<&'static dyn Format>,
    /// The unit to write in; the input's if `None`.
    pub unit: Option<Unit>,
    /// The axis that is to point up; the input's if `None`.
    pub up: Option<Direction>,
    /// Replace a file that exists.
    pub force: bool,
}

/// What was done.
#[derive(Clone, Debug)]
pub struct Converted {
    input: PathBuf,
    output: PathBuf,
    from: &'static str,
    to: &'static str,
    /// The input's bytes were copied: nothing was to be converted.
    copied: bool,
    markers: usize,
    frames: usize,
    rate_hz: f64,
    unit: Unit,
    up: Option<Direction>,
    notes: Vec<Note>,
}

/// Converts one take.
///
/// # Errors
/// The take cannot be read or written so, or the way up is not known. Then no file was written.
pub fn convert(wanted: &Conversion) -> Result<Converted, RepairError> {
    Names { input: &wanted.input, output: &wanted.output, reads: vec![], beside: Vec::new(), in_place: false, force: wanted.force }
        .check()?;
    let opened = open(&wanted.input, &wanted.reading)?;
    let take = changed(wanted, &opened)?;
    let same = unchanged(wanted, &opened, &take)?;
    let input = opened.format;
    if let Some(to) = wanted.to {
        agrees(&wanted.output, to)?;
    }
    let way = match (wanted.to, output::way(&wanted.input, input, &wanted.output)) {
        (Some(to), _) if to.info().name != input.info().name => Way::New(to),
        (None, Way::New(to)) => Way::New(to),
        _ if same => Way::Patched,
        _ => Way::New(input),
    };
    let compressed = compression::is_named(&wanted.output);
    let whole = !wanted.reading.float && compressed == opened.compressed;
    let Written { file, notes, .. } = output::write(way, opened, &take, compressed, &wanted.output)?;
    staging::publish(file, &wanted.output).map_err(|e| output::unwritable(&wanted.output, &e))?;
    let (to, copied) = match way {
        Way::Patched => (input, whole),
        Way::New(to) => (to, false),
    };
    Ok(Converted {
        input: wanted.input.clone(),
        output: wanted.output.clone(),
        from: input.info().name,
        to: to.info().name,
        copied,
        markers: take.markers.iter().filter(|m| m.role == Role::Marker).count(),
        frames: take.frames(),
        rate_hz: take.rate_hz,
        unit: take.unit,
        up: take.up,
        notes: notes.take(),
    })
}

/// True if the file that was opened says by itself all that the written one is to say, so that its bytes will do.
fn unchanged(wanted: &Conversion, opened: &Opened, take: &Take) -> Result<bool, RepairError> {
    let said = |take: &Take| (take.rate_hz, take.unit, take.up);
    let stated = &opened.stated;
    if !stated.missing.is_empty() || wanted.up.is_some() || said(take) != said(opened.document.take()) {
        return Ok(false);
    }
    let silent = |notes: &Notes| notes.take().iter().any(|n| matches!(n, Note::UnitAssumed { .. } | Note::UnitUnknown { .. }));
    if stated.rate_hz.is_none() && stated.unit.is_none() {
        return Ok(wanted.unit.is_none() || !silent(&opened.notes));
    }
    let alone = open(&wanted.input, &Reading::default())?;
    Ok(said(alone.document.take()) == said(take) && !(silent(&alone.notes) && (wanted.unit.is_some() || stated.unit.is_some())))
}

/// A name must not belong to other formats only.
fn agrees(output: &Path, to: &'static dyn Format) -> Result<(), RepairError> {
    let inner = compression::inner_name(output);
    let extension = inner.extension().and_then(|e| e.to_str()).unwrap_or_default().to_ascii_lowercase();
    match formats::by_extension(&extension) {
        Some(usual) if !to.info().extensions.contains(&extension.as_str()) => {
            let (name, usual, right) = (to.info().name, usual.info().name, to.info().extensions.first().copied().unwrap_or_default());
            let problem = format!("is named like {usual}, but --to asks for {name}; name it .{right}");
            Err(RepairError::Io { path: output.to_owned(), problem })
        }
        _ => Ok(()),
    }
}

/// The take as it is to be written.
fn changed(wanted: &Conversion, opened: &Opened) -> Result<Take, RepairError> {
    let mut take = opened.document.take().clone();
    if let Some(from) = wanted.from_up {
        take.up = Some(from);
    }
    if let Some(to) = wanted.up {
        let from = take.up.ok_or_else(|| RepairError::NoUp { path: wanted.input.clone() })?;
        let outputs = take.markers.iter().filter(|m| m.role == Role::ModelOutput).count();
        if outputs > 0 && from != to {
            let columns = count(outputs, "column");
            opened.notes.add(Note::Assumed { text: format!("{columns} of model outputs were not turned with the markers") });
        }
        take = take.turned(from, to);
    }
    if let Some(unit) = wanted.unit {
        take.unit = unit;
    }
    Ok(take)
}

/// A note in the words of this command, where `--units` is what is written.
fn told(note: &Note) -> String {
    note.to_string().replace("--units", "--from-units")
}

impl Converted {
    /// 0 if nothing was lost or assumed, else 3.
    pub fn exit_code(&self) -> u8 {
        if self.notes.iter().any(Note::matters) { 3 } else { 0 }
    }

    /// As JSON lines: notes, then what was done.
    pub fn json(&self) -> String {
        #[derive(Serialize)]
        #[serde(tag = "message_type", rename_all = "snake_case")]
        enum Message<'a> {
            Note {
                kind: &'a str,
                text: String,
                matters: bool,
            },
            Converted {
                input: String,
                output: String,
                from: &'a str,
                to: &'a str,
                copied: bool,
                markers: usize,
                frames: usize,
                rate_hz: f64,
                unit: &'a str,
                up: Option<String>,
                exit_code: u8,
            },
        }
        let mut messages: Vec<Message> =
            self.notes.iter().map(|n| Message::Note { kind: n.kind(), text: told(n), matters: n.matters() }).collect();
        messages.push(Message::Converted {
            input: self.input.display().to_string(),
            output: self.output.display().to_string(),
            from: self.from,
            to: self.to,
            copied: self.copied,
            markers: self.markers,
            frames: self.frames,
            rate_hz: self.rate_hz,
            unit: self.unit.symbol(),
            up: self.up.map(|up| up.to_string()),
            exit_code: self.exit_code(),
        });
        lines(&messages)
    }

    /// For people.
    pub fn text(&self, style: &Style) -> String {
        let mut out = style.way(&self.input.display().to_string(), &self.output.display().to_string());
        let how = if self.copied { format!("{}, copied byte for byte", self.from) } else { format!("{} to {}", self.from, self.to) };
        let up = self.up.map(|up| format!(", {up} up")).unwrap_or_default();
        out.push_str(&style.sentence(&format!(
            "{how}: {}, {} at {} Hz, in {}{up}",
            count(self.markers, "marker"),
            count(self.frames, "frame"),
            short(self.rate_hz),
            self.unit.symbol()
        )));
        for note in &self.notes {
            out.push_str(&style.item(if note.matters() { "look at" } else { "note" }, &told(note)));
        }
        out
    }
}
