//! Skeletons: `KBSKEL`, the number of joints, for every joint its name, its type and its parent (or NULL), then for every joint its numbers.
//!
//! | type | numbers | and perhaps |
//! | --- | --- | --- |
//! | `translate` | centre | shift to begin with |
//! | `revolute` | centre, axis | angle to begin with, radians |
//! | `ball` | centre | rotation vector to begin with, radians |
//!
//! White space of any kind separates words, and lines mean nothing.
//! The report's grammar gives a revolute joint one number, from which nobody can tell where it is and about what it turns.

use super::records::{NOBODY, Names, head, how_many, joint, name, note_count, numbers, triple, written};
use super::words::{Word, Words, excerpt, normalised, wrong};
use super::{Joint, JointKind, Skeleton};
use crate::note::listed;
use crate::{FormatError, Note, Notes, Place};
use std::io::{self, BufWriter, Write};

const NAME: &str = "skl";
const FIRST: &str = "KBSKEL";
/// The shortest axis; anything shorter has no direction.
const SHORTEST_AXIS: f64 = 1e-9;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Kind {
    Translate,
    Revolute,
    Ball,
}

impl Kind {
    fn parse(word: Word<'_>) -> Option<Self> {
        let word = word.text.to_ascii_lowercase();
        match word.strip_prefix(b"kbjoint_").unwrap_or(&word) {
            b"translate" => Some(Self::Translate),
            b"revolute" => Some(Self::Revolute),
            b"ball" => Some(Self::Ball),
            _ => None,
        }
    }

    fn word(self) -> &'static str {
        match self {
            Self::Translate => "translate",
            Self::Revolute => "revolute",
            Self::Ball => "ball",
        }
    }

    /// Numbers of its place, and of the state to begin with.
    fn numbers(self) -> (usize, usize) {
        match self {
            Self::Translate | Self::Ball => (3, 3),
            Self::Revolute => (6, 1),
        }
    }
}

/// A joint as it was declared.
struct Declared {
    name: String,
    kind: Kind,
    parent: Option<usize>,
    line: u64,
}

/// What stands in the second part about a joint.
struct Placed {
    centre: [f64; 3],
    axis: [f64; 3],
    state: [f64; 3],
}

/// Reads a skeleton. Lengths stay in the unit of the file, which does not tell it; axes get length 1. Joints are sorted, parents first,
/// if they are not so in the file. That, and a wrong count, is noted.
///
/// # Errors
/// Malformed: a parent or a joint that is not there, a name twice, no root or two, joints that hang on each other in a circle, a joint without
/// coordinates, another number of coordinates than its type has, an axis of length 0.
pub fn read_skeleton(bytes: &[u8], notes: &Notes) -> Result<Skeleton, FormatError> {
    let mut words = Words::new(NAME, bytes);
    let claimed = head(&mut words, NAME, FIRST, "joints")?;
    let (declared, names) = read_tree(&mut words)?;
    note_count(notes, FIRST, "joints", claimed, declared.len());
    let placed = read_places(&mut words, &declared, &names)?;
    let order = parents_first(&declared, notes)?;
    let mut place_of = vec![0; declared.len()];
    let mut skeleton = Skeleton::default();
    for at in order {
        let (Some(joint), Some(Some(placed))) = (declared.get(at), placed.get(at)) else { continue };
        if let Some(place) = place_of.get_mut(at) {
            *place = skeleton.joints.len();
        }
        skeleton.joints.push(Joint {
            name: joint.name.clone(),
            kind: match joint.kind {
                Kind::Translate => JointKind::Translate,
                Kind::Revolute => JointKind::Revolute { axis: placed.axis },
                Kind::Ball => JointKind::Ball,
            },
            parent: joint.parent.and_then(|parent| place_of.get(parent).copied()),
            centre: placed.centre,
            state: placed.state,
        });
    }
    Ok(skeleton)
}

/// Reads names, types and parents, up to the first name with a number behind it.
fn read_tree(words: &mut Words<'_>) -> Result<(Vec<Declared>, Names), FormatError> {
    let mut declared: Vec<Declared> = Vec::new();
    let mut names = Names::new();
    let mut parents: Vec<Word<'_>> = Vec::new();
    loop {
        let mut ahead = words.clone();
        let Some(first) = ahead.word() else { break };
        let Some(second) = ahead.word() else {
            return Err(first.wrong(NAME, format!("the file ends behind \"{}\"; it was cut off", first.shown())));
        };
        let Some(kind) = Kind::parse(second) else {
            if second.number().is_some() && !declared.is_empty() {
                break;
            }
            let text = format!("\"{}\" found behind the name \"{}\", expected translate, revolute or ball", second.shown(), first.shown());
            return Err(second.wrong(NAME, text));
        };
        let Some(parent) = ahead.word() else {
            let text = format!("the file ends behind the type of \"{}\", expected its parent or {NOBODY}; it was cut off", first.shown());
            return Err(second.wrong(NAME, text));
        };
        let name = name(first, NAME)?;
        if names.insert(name.clone(), declared.len()).is_some() {
            return Err(first.wrong(NAME, format!("there are two joints of the name \"{}\"; rename one of them", first.shown())));
        }
        declared.push(Declared { name, kind, parent: None, line: first.line });
        parents.push(parent);
        *words = ahead;
    }
    if declared.is_empty() {
        return Err(words.wrong("there are no joints; expected a name, a type and a parent for each"));
    }
    let mut root: Option<u64> = None;
    for (own, word) in declared.iter_mut().zip(parents) {
        let text = String::from_utf8_lossy(word.text);
        own.parent = names.get(text.as_ref()).copied();
        if own.parent.is_some() {
            continue;
        }
        if !text.eq_ignore_ascii_case(NOBODY) {
            let text = format!(
                "the parent \"{}\" of \"{}\" is no joint; correct it, or write {NOBODY} if there is none",
                word.shown(),
                excerpt(own.name.as_bytes())
            );
            return Err(word.wrong(NAME, text));
        }
        if let Some(line) = root {
            let text = format!(
                "\"{}\" is a second root, the first is in line {line}; only one joint may have the parent {NOBODY}",
                excerpt(own.name.as_bytes())
            );
            return Err(word.wrong(NAME, text));
        }
        root = Some(own.line);
    }
    Ok((declared, names))
}

fn read_places(words: &mut Words<'_>, declared: &[Declared], names: &Names) -> Result<Vec<Option<Placed>>, FormatError> {
    let mut all: Vec<Option<Placed>> = declared.iter().map(|_| None).collect();
    while let Some(word) = words.word() {
        let at = joint(word, NAME, names)?;
        let (Some(own), Some(placed)) = (declared.get(at), all.get_mut(at)) else { continue };
        if placed.is_some() {
            return Err(word.wrong(NAME, format!("\"{}\" has its coordinates twice; take one of them away", word.shown())));
        }
        *placed = Some(read_place(words, word, own.kind, names)?);
    }
    if let Some((own, _)) = declared.iter().zip(&all).find(|(_, placed)| placed.is_none()) {
        let text =
            format!("\"{}\" has no coordinates; add its name and its {} behind the joints", excerpt(own.name.as_bytes()), wanted(own.kind));
        return Err(wrong(NAME, own.line, text));
    }
    Ok(all)
}

/// What a joint needs, in words.
fn wanted(kind: Kind) -> &'static str {
    match kind {
        Kind::Revolute => "six numbers: where it is, and the axis about which it turns",
        Kind::Translate | Kind::Ball => "three numbers: where it is",
    }
}

fn read_place(words: &mut Words<'_>, word: Word<'_>, kind: Kind, names: &Names) -> Result<Placed, FormatError> {
    let (least, state) = kind.numbers();
    let found = numbers(words, names, least);
    let count = found.len();
    if count != least && count != least + state {
        if let Some(next) = words.clone().word()
            && count < least
            && joint(next, NAME, names).is_err()
        {
            let text = format!("\"{}\" found among the numbers of \"{}\", expected {}", next.shown(), word.shown(), wanted(kind));
            return Err(next.wrong(NAME, text));
        }
        let why = match (kind, count) {
            (Kind::Revolute, 1) => "; one alone can be its angle, but does not tell where it is and about which axis it turns",
            _ => "",
        };
        let text = format!(
            "\"{}\" has {} behind it, a {} joint has {}, and perhaps {} of the pose to begin with{why}",
            word.shown(),
            how_many(count),
            kind.word(),
            wanted(kind),
            how_many(state)
        );
        return Err(word.wrong(NAME, text));
    }
    let (place, rest) = found.split_at_checked(3).unwrap_or_default();
    let centre = triple(place).unwrap_or_default();
    let mut axis = [0.0; 3];
    let mut tail = rest;
    if kind == Kind::Revolute {
        let (numbers, behind) = rest.split_at_checked(3).unwrap_or_default();
        tail = behind;
        axis = triple(numbers).and_then(|axis| normalised(axis, SHORTEST_AXIS)).ok_or_else(|| {
            let text = format!(
                "the axis of \"{}\" has no length, so it has no direction; give the direction about which the joint turns",
                word.shown()
            );
            word.wrong(NAME, text)
        })?;
    }
    let mut state = [0.0; 3];
    for (to, from) in state.iter_mut().zip(tail) {
        *to = *from;
    }
    Ok(Placed { centre, axis, state })
}

/// The joints in the order of the file, but for those that stand before their parents.
fn parents_first(declared: &[Declared], notes: &Notes) -> Result<Vec<usize>, FormatError> {
    let mut order = Vec::with_capacity(declared.len());
    // 0 = not yet, 1 = in the chain that is being followed, 2 = in `order`
    let mut state = vec![0_u8; declared.len()];
    let mut chain = Vec::new();
    let mut early = Vec::new();
    for at in 0..declared.len() {
        let mut next = Some(at);
        while let Some(at) = next {
            match state.get_mut(at) {
                Some(mark @ 0) => *mark = 1,
                Some(1) => return Err(circle(declared, &chain, at)),
                _ => break,
            }
            chain.push(at);
            next = declared.get(at).and_then(|joint| joint.parent);
        }
        if chain.len() > 1 {
            early.extend(chain.first().and_then(|&at| declared.get(at)).map(|joint| excerpt(joint.name.as_bytes())));
        }
        while let Some(at) = chain.pop() {
            if let Some(mark) = state.get_mut(at) {
                *mark = 2;
            }
            order.push(at);
        }
    }
    if !early.is_empty() {
        let text = format!("joints stand before their parents: {}; they were sorted, parents first", listed(&early));
        notes.add(Note::Contradiction { text });
    }
    Ok(order)
}

fn circle(declared: &[Declared], chain: &[usize], at: usize) -> FormatError {
    let members = chain.iter().skip_while(|&&member| member != at).filter_map(|&member| declared.get(member));
    let names: Vec<String> = members.map(|joint| excerpt(joint.name.as_bytes())).collect();
    let line = declared.get(at).map_or(1, |joint| joint.line);
    let text = if let [name] = names.as_slice() {
        format!("\"{name}\" hangs on itself; name its parent, or {NOBODY} if there is none")
    } else {
        format!("these joints hang on each other in a circle: {}; correct the parent of one of them", listed(&names))
    };
    wrong(NAME, line, text)
}

/// Writes a skeleton, with the states to begin with where they are not 0. Numbers have the fewest digits that read back as the same number.
/// Names that the file cannot hold are changed: blanks and `#` become `_`, and those that are the same get numbers.
///
/// # Errors
/// Unsupported: coordinates that are no numbers, or a parent that is not before its child. Or an I/O error of `out`.
pub fn write_skeleton(skeleton: &Skeleton, out: &mut dyn Write) -> Result<(), FormatError> {
    for (at, joint) in skeleton.joints.iter().enumerate() {
        let axis = if let JointKind::Revolute { axis } = joint.kind { axis } else { [0.0; 3] };
        if !joint.centre.iter().chain(&joint.state).chain(&axis).all(|x| x.is_finite()) {
            let text = format!("joint \"{}\" has a coordinate that is no number", excerpt(joint.name.as_bytes()));
            return Err(FormatError::unsupported(NAME, Place::Whole, text));
        }
        if joint.parent.is_none() != (at == 0) || joint.parent.is_some_and(|parent| parent >= at) {
            let text = format!("joint \"{}\" does not hang on one before it", excerpt(joint.name.as_bytes()));
            return Err(FormatError::unsupported(NAME, Place::Whole, text));
        }
    }
    let mut out = BufWriter::new(out);
    write_all(skeleton, &mut out).and_then(|()| out.flush()).map_err(|e| FormatError::io(NAME, e))
}

fn write_all(skeleton: &Skeleton, out: &mut dyn Write) -> io::Result<()> {
    let names = written(skeleton);
    writeln!(out, "{FIRST} {}", skeleton.joints.len())?;
    for (joint, name) in skeleton.joints.iter().zip(&names) {
        let kind = match joint.kind {
            JointKind::Translate => Kind::Translate,
            JointKind::Revolute { .. } => Kind::Revolute,
            JointKind::Ball => Kind::Ball,
        };
        let parent = joint.parent.and_then(|parent| names.get(parent));
        writeln!(out, "{name} {} {}", kind.word(), parent.map_or(NOBODY, String::as_str))?;
    }
    for (joint, name) in skeleton.joints.iter().zip(&names) {
        write!(out, "{name}")?;
        let mut numbers = joint.centre.to_vec();
        if let JointKind::Revolute { axis } = joint.kind {
            numbers.extend(axis);
        }
        if joint.state != [0.0; 3] {
            numbers.extend(joint.state.iter().take(joint.kind.freedom()));
        }
        for x in numbers {
            let mut text = (x + 0.0).to_string(); // no "-0"
            // a number that is spelled as a joint is called would be one
            if names.contains(&text) {
                text += if text.contains('.') { "0" } else { ".0" };
            }
            while names.contains(&text) {
                text += "0";
            }
            write!(out, " {text}")?;
        }
        writeln!(out)?;
    }
    Ok(())
}
