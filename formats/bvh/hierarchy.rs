//! The text from HIERARCHY to MOTION → the skeleton. Nested brackets are a list of open joints, so depth costs nothing.

use super::scan::{Cursor, excerpt, number};
use super::{NAME, create};
use crate::text::scan::letters;
use crate::{FormatError, Marker, Place, Unit};
use std::collections::{BTreeMap, BTreeSet};

/// More joints than any skeleton has. A limit keeps names of end sites, which are made from those of their joints, from outgrowing the file.
const MOST_NODES: usize = 100_000;
/// The longest name, in bytes.
const LONGEST_NAME: usize = 1000;

/// What a channel moves.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Channel {
    /// Along an axis: 0 = x, 1 = y, 2 = z.
    Position(usize),
    /// About an axis, in degrees.
    Rotation(usize),
}

impl Channel {
    fn parse(word: &[u8]) -> Option<Self> {
        let (letter, kind) = word.split_first()?;
        let axis = match letter.to_ascii_lowercase() {
            b'x' => 0,
            b'y' => 1,
            b'z' => 2,
            _ => return None,
        };
        match kind.to_ascii_lowercase().as_slice() {
            b"position" => Some(Self::Position(axis)),
            b"rotation" => Some(Self::Rotation(axis)),
            _ => None,
        }
    }
}

/// A joint or an end site.
#[derive(Clone, Debug)]
pub(crate) struct Node {
    /// The name as written; end sites get one.
    pub label: String,
    /// The joint that it hangs on, which comes earlier.
    pub parent: Option<usize>,
    /// From the parent, in the file's unit.
    pub offset: [f64; 3],
    /// What it reads of each row, in this order.
    pub channels: Vec<Channel>,
    /// Its first value in each row.
    pub first_channel: usize,
    /// True for an end site.
    pub end: bool,
    /// True if something hangs on it.
    pub inner: bool,
    /// Its column in the take.
    pub marker: Option<usize>,
}

impl Node {
    /// Its channels with their places in a row.
    pub fn channels(&self) -> impl Iterator<Item = (usize, Channel)> {
        (self.first_channel..).zip(self.channels.iter().copied())
    }

    /// True if it turns what hangs on it.
    pub fn turns(&self) -> bool {
        self.channels.iter().any(|c| matches!(c, Channel::Rotation(_)))
    }

    /// True if rows say where it is.
    pub fn is_placed(&self) -> bool {
        self.channels.iter().any(|c| matches!(c, Channel::Position(_)))
    }
}

/// Joints and end sites in the order of the file.
#[derive(Clone, Debug)]
pub(super) struct Skeleton {
    /// Parents come before their children.
    pub nodes: Vec<Node>,
    /// How many values a row has.
    pub channels: usize,
    /// The root is nothing but the origin of a cloud of points in this unit, and no marker.
    pub cloud: Option<Unit>,
}

/// A block whose bracket is open.
struct Open {
    node: usize,
    line: u64,
    offset: bool,
    channels: bool,
}

impl Skeleton {
    /// Reads up to and including the word MOTION.
    pub fn read(cursor: &mut Cursor<'_>) -> Result<Self, FormatError> {
        if !cursor.word().eq_ignore_ascii_case(b"hierarchy") {
            return Err(cursor.wrong("a BVH file begins with the word HIERARCHY, this one does not"));
        }
        let mut skeleton = Self { nodes: Vec::new(), channels: 0, cloud: None };
        let mut open: Vec<Open> = Vec::new();
        loop {
            let word = cursor.word();
            match word.to_ascii_lowercase().as_slice() {
                b"root" if open.is_empty() => skeleton.begin(cursor, &mut open, false)?,
                b"joint" if !open.is_empty() => skeleton.begin(cursor, &mut open, false)?,
                b"end" if !open.is_empty() && cursor.next_word().eq_ignore_ascii_case(b"site") => {
                    cursor.word();
                    skeleton.begin(cursor, &mut open, true)?;
                }
                b"offset" => skeleton.offset(cursor, open.last_mut())?,
                b"channels" => skeleton.read_channels(cursor, open.last_mut())?,
                b"}" => match open.pop() {
                    Some(block) if !block.offset => return Err(cursor.wrong("the joint that ends here has no OFFSET; add it")),
                    Some(_) => {}
                    None => return Err(cursor.wrong("a bracket closes here that was never opened; take it away")),
                },
                b"motion" => break,
                b"" => return Err(cursor.wrong("the file ends before the word MOTION; it was cut off")),
                _ if Channel::parse(word).is_some() => {
                    return Err(cursor.wrong(format!("\"{}\" is one channel more than CHANNELS says; correct its number", excerpt(word))));
                }
                b"root" | b"joint" | b"end" => {
                    let text =
                        format!("{} does not belong here; a ROOT stands outside of all brackets, JOINT and End Site inside", excerpt(word));
                    return Err(cursor.wrong(text));
                }
                _ => {
                    let text = format!("\"{}\" found, expected JOINT, End Site, OFFSET, CHANNELS, a bracket or MOTION", excerpt(word));
                    return Err(cursor.wrong(text));
                }
            }
        }
        if let Some(block) = open.last() {
            return Err(cursor.wrong(format!("MOTION found, but the bracket opened in line {} was not closed; close it", block.line)));
        }
        if skeleton.nodes.is_empty() {
            return Err(cursor.wrong("there is no ROOT before MOTION, so there is nothing that moves"));
        }
        if skeleton.channels == 0 {
            return Err(cursor.wrong("no joint has CHANNELS, so there is nothing that moves"));
        }
        skeleton.name_ends();
        Ok(skeleton)
    }

    fn begin(&mut self, cursor: &mut Cursor<'_>, open: &mut Vec<Open>, end: bool) -> Result<(), FormatError> {
        let name = cursor.name();
        if name.len() > LONGEST_NAME {
            return Err(cursor.wrong(format!("a name of {} bytes; the longest that is read has {LONGEST_NAME}", name.len())));
        }
        if self.nodes.len() >= MOST_NODES {
            let place = Place::Line { line: cursor.line(), column: None };
            return Err(FormatError::too_large(NAME, place, format!("more than {MOST_NODES} joints, which is the most that is read")));
        }
        if cursor.word() != b"{" {
            return Err(cursor.wrong(format!("expected an opening bracket after the name \"{}\"", excerpt(name))));
        }
        let parent = open.last().map(|block| block.node);
        if let Some(parent) = parent.and_then(|p| self.nodes.get_mut(p)) {
            parent.inner = true;
        }
        open.push(Open { node: self.nodes.len(), line: cursor.line(), offset: false, channels: false });
        self.nodes.push(Node {
            label: letters(name),
            parent,
            offset: [0.0; 3],
            channels: Vec::new(),
            first_channel: self.channels,
            end,
            inner: false,
            marker: None,
        });
        Ok(())
    }

    fn offset(&mut self, cursor: &mut Cursor<'_>, open: Option<&mut Open>) -> Result<(), FormatError> {
        let Some(block) = open.filter(|block| !block.offset) else {
            return Err(cursor.wrong("OFFSET does not belong here; there is one in each pair of brackets"));
        };
        let Some(node) = self.nodes.get_mut(block.node) else { return Ok(()) };
        for x in &mut node.offset {
            let word = cursor.word();
            *x = number(word)
                .ok_or_else(|| cursor.wrong(format!("\"{}\" found, expected the three numbers of an OFFSET", excerpt(word))))?;
        }
        block.offset = true;
        Ok(())
    }

    fn read_channels(&mut self, cursor: &mut Cursor<'_>, open: Option<&mut Open>) -> Result<(), FormatError> {
        let Some(block) = open.filter(|block| !block.channels) else {
            return Err(cursor.wrong("CHANNELS does not belong here; there is one at most in each pair of brackets"));
        };
        let Some(node) = self.nodes.get_mut(block.node) else { return Ok(()) };
        let word = cursor.word();
        let count = std::str::from_utf8(word).ok().and_then(|w| w.parse::<usize>().ok());
        let count = count.ok_or_else(|| cursor.wrong(format!("\"{}\" found, expected the number of CHANNELS", excerpt(word))))?;
        // Children may have come first, in a file that is written that way round; rows follow the order of CHANNELS.
        node.first_channel = self.channels;
        for _ in 0..count {
            let word = cursor.word();
            let channel = Channel::parse(word).ok_or_else(|| {
                let text = "expected Xposition, Yposition, Zposition, Xrotation, Yrotation or Zrotation, as many as CHANNELS says";
                cursor.wrong(format!("\"{}\" found, {text} ({count})", excerpt(word)))
            })?;
            if matches!(channel, Channel::Position(_)) && node.channels.contains(&channel) {
                return Err(cursor.wrong(format!("{} occurs twice in one joint", excerpt(word))));
            }
            node.channels.push(channel);
        }
        self.channels = self.channels.saturating_add(count);
        block.channels = true;
        Ok(())
    }

    /// Names end sites after their joints: `LeftToe_end`, and with a number behind it where that is taken.
    fn name_ends(&mut self) {
        let mut taken: BTreeSet<String> = self.nodes.iter().map(|n| n.label.clone()).collect();
        let mut next: BTreeMap<usize, usize> = BTreeMap::new();
        // The joint that is not an end site, upwards from each node.
        let mut joints: Vec<usize> = Vec::with_capacity(self.nodes.len());
        for at in 0..self.nodes.len() {
            let above = self.nodes.get(at).filter(|n| n.end).and_then(|n| joints.get(n.parent?).copied());
            joints.push(above.unwrap_or(at));
            let unnamed = self.nodes.get(at).is_some_and(|n| n.end && n.label.is_empty());
            let (true, Some(above)) = (unnamed, above) else { continue };
            let base = self.nodes.get(above).map(|n| n.label.clone()).unwrap_or_default();
            let count = next.entry(above).or_insert(1);
            let label = loop {
                let label = if *count == 1 { format!("{base}_end") } else { format!("{base}_end{count}") };
                *count += 1;
                if taken.insert(label.clone()) {
                    break label;
                }
            };
            if let Some(node) = self.nodes.get_mut(at) {
                node.label = label;
            }
        }
    }

    /// The unit, if this is a skeleton as [`create`] makes it: a root at the origin with a telling name, and nothing below it but points.
    pub fn looks_like_cloud(&self) -> Option<Unit> {
        let (root, rest) = self.nodes.split_first()?;
        let points = rest.iter().all(|n| {
            let point = n.parent == Some(0) && !n.end && n.channels.len() == 3 && !n.turns();
            let end = n.end && n.channels.is_empty() && n.parent.is_some_and(|p| p != 0);
            n.offset == [0.0; 3] && (point || end)
        });
        create::unit_of(&root.label).filter(|_| points && root.offset == [0.0; 3] && rest.iter().any(|n| !n.end))
    }

    /// Gives a column to every joint and end site, except to end sites that are where their joint is, and to the root of a cloud of points.
    pub fn markers(&mut self) -> Vec<Marker> {
        let mut markers = Vec::with_capacity(self.nodes.len());
        for (at, node) in self.nodes.iter_mut().enumerate() {
            let nowhere = node.end && node.offset == [0.0; 3] && node.channels.is_empty();
            let origin = self.cloud.is_some() && at == 0;
            node.marker = (!nowhere && !origin).then_some(markers.len());
            if node.marker.is_some() {
                markers.push(Marker::new(node.label.clone()));
            }
        }
        markers
    }
}
