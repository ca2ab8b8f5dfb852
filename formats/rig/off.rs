//! Surfaces and clouds of points: OFF, read for every frame of a sequence, so read fast.
//!
//! | line | holds |
//! | --- | --- |
//! | `[ST][C][N]OFF` | colours and texture coordinates are skipped, normals kept; the word may lack |
//! | `vertices faces edges` | counts, perhaps in the line of the word; edges are ignored |
//! | `x y z [nx ny nz] [colour] [s t]` | a vertex |
//! | `corners a b c ... [colour]` | a face; more than three corners become a fan of triangles, fewer have no surface |

use super::Mesh;
use super::words::{Word, Words, normalised};
use crate::{FormatError, Note, Notes, Place};
use std::io::{self, BufWriter, Write};

const NAME: &str = "off";

/// The shortest line that can hold a vertex.
const SHORTEST_VERTEX: usize = 6;
/// Numbers of a colour, at most, and of a place in a texture.
const COLOUR: usize = 4;
const TEXTURE: usize = 2;
/// Normals that are written with a few decimals have lengths like these.
const LENGTH_OF_NORMALS: std::ops::RangeInclusive<f64> = 0.95..=1.05;

/// What a line of a vertex holds behind the coordinates.
#[derive(Clone, Copy, Debug, Default)]
struct Layout {
    normals: bool,
    colours: bool,
    texture: bool,
}

/// Reads a surface or a cloud of points. Lengths stay in the unit of the file, which OFF does not tell; normals get length 1, or are 0 0 0 where
/// the file says so. A file of no vertices is an empty [`Mesh`]. Normals that the first word does not announce are read, and noted.
///
/// # Errors
/// Malformed: another number of lines than the counts say, something else than finite numbers, a face with a vertex that is not there.
/// Unsupported: binary files, and points of other than three coordinates.
pub fn read_mesh(bytes: &[u8], notes: &Notes) -> Result<Mesh, FormatError> {
    let mut words = Words::new(NAME, bytes);
    let layout = header(&mut words)?;
    let vertices = count(&mut words, "the number of vertices")?;
    let faces = count(&mut words, "the number of faces")?;
    let edges = words.word_here();
    if edges.is_some_and(|word| word.number().is_none()) || words.word_here().is_some() {
        return Err(words.wrong("expected nothing but the numbers of vertices, faces and edges in this line"));
    }
    if u32::try_from(vertices).is_err() {
        let text = format!("{vertices} vertices; the most that are read are {}", u32::MAX);
        return Err(FormatError::too_large(NAME, Place::Whole, text));
    }
    let mut mesh = Mesh::default();
    let room = usize::try_from(vertices).unwrap_or(usize::MAX).min(words.left() / SHORTEST_VERTEX + 1);
    mesh.vertices.reserve_exact(room);
    mesh.normals.reserve_exact(if layout.normals { room } else { 0 });
    let mut behind = Vec::new();
    for _ in 0..vertices {
        if !words.seek() {
            let text =
                format!("the file ends after {} of {vertices} vertices; it was cut off, or its counts are wrong", mesh.vertices.len());
            return Err(words.wrong(text));
        }
        mesh.vertices.push(triple(&mut words, "a coordinate (three in each line of a vertex)")?);
        if layout.normals {
            let normal = triple(&mut words, "a coordinate of a normal (three behind those of the vertex)")?;
            mesh.normals.push(normalised(normal, 0.0).unwrap_or_default());
        }
        if let Some(triple) = skip_colours(&mut words, layout)?
            && behind.len() + 1 == mesh.vertices.len()
        {
            behind.push(triple);
        }
    }
    if let Some(normals) = unannounced_normals(&behind, layout, &mesh) {
        let text = "OFF at the beginning says nothing of normals, but three numbers behind each vertex have length 1, and some are negative, which no \
                    colour is; they were read as normals";
        notes.add(Note::Contradiction { text: text.to_owned() });
        mesh.normals = normals;
    }
    for read in 0..faces {
        if !words.seek() {
            let text = format!("the file ends after {read} of {faces} faces; it was cut off, or its counts are wrong");
            return Err(words.wrong(text));
        }
        read_face(&mut words, vertices, &mut mesh.faces)?;
    }
    if words.seek() {
        let text = format!(
            "there is more than the {vertices} vertices and {faces} faces that the counts say; nothing was skipped, correct the counts"
        );
        return Err(words.wrong(text));
    }
    Ok(mesh)
}

/// Reads the word at the beginning, if there is one.
fn header(words: &mut Words<'_>) -> Result<Layout, FormatError> {
    let mut layout = Layout::default();
    let mut ahead = words.clone();
    let Some(word) = ahead.word() else { return Err(words.wrong("the file is empty; expected OFF and the numbers of vertices and faces")) };
    if word.number().is_some() {
        return Ok(layout);
    }
    let shouting = word.text.iter().any(u8::is_ascii_uppercase);
    let Some(mut letters) = strip_suffix(word.text, b"OFF", shouting) else {
        let text = format!("\"{}\" found, expected OFF or NOFF, or the numbers of vertices and faces", word.shown());
        return Err(word.wrong(NAME, text));
    };
    while let [first, behind @ ..] = letters {
        letters = behind;
        match (first.to_ascii_uppercase(), behind) {
            (b'N', _) if *first == b'n' && shouting => return Err(other_dimension(word)),
            (b'N', _) => layout.normals = true,
            (b'C', _) => layout.colours = true,
            (b'S', [b't' | b'T', behind @ ..]) => {
                layout.texture = true;
                letters = behind;
            }
            (b'4', _) => return Err(other_dimension(word)),
            _ => return Err(word.wrong(NAME, format!("\"{}\" found, expected OFF or NOFF", word.shown()))),
        }
    }
    *words = ahead;
    if let Some(next) = ahead_of(words)
        && next.text.eq_ignore_ascii_case(b"binary")
    {
        let place = Place::Line { line: next.line, column: None };
        return Err(FormatError::unsupported(NAME, place, "this is a binary OFF file; write it again as text"));
    }
    Ok(layout)
}

fn ahead_of<'a>(words: &Words<'a>) -> Option<Word<'a>> {
    words.clone().word_here()
}

/// What stands before `end`; `end` has to be written as it is here, or all of the word in lower case.
fn strip_suffix<'a>(text: &'a [u8], end: &[u8], shouting: bool) -> Option<&'a [u8]> {
    let (letters, last) = text.split_at_checked(text.len().checked_sub(end.len())?)?;
    (last == end || !shouting && last.eq_ignore_ascii_case(end)).then_some(letters)
}

fn other_dimension(word: Word<'_>) -> FormatError {
    let text = format!("{} holds points of other than three coordinates; write it again as OFF or NOFF", word.shown());
    FormatError::unsupported(NAME, Place::Line { line: word.line, column: None }, text)
}

fn count(words: &mut Words<'_>, what: &str) -> Result<u64, FormatError> {
    if !words.seek() {
        return Err(words.wrong(format!("the file ends where {what} is expected; it was cut off")));
    }
    words.whole_here(what)
}

fn triple(words: &mut Words<'_>, what: &str) -> Result<[f64; 3], FormatError> {
    Ok([words.number_here(what)?, words.number_here(what)?, words.number_here(what)?])
}

/// Colours may also stand where the word at the beginning does not say so. What comes out are three numbers, if there are just so many.
fn skip_colours(words: &mut Words<'_>, layout: Layout) -> Result<Option<[f64; 3]>, FormatError> {
    let most = COLOUR + if layout.texture { TEXTURE } else { 0 };
    let mut seen = 0;
    let mut triple = [0.0; 3];
    while let Some(word) = words.word_here() {
        let number = word.number();
        if let (Some(place), Some(number)) = (triple.get_mut(seen), number) {
            *place = number;
        }
        seen += 1;
        if seen > most || number.is_none() {
            let text = format!(
                "\"{}\" found behind a vertex, expected the end of the line, or a colour of at most {COLOUR} numbers",
                word.shown()
            );
            return Err(word.wrong(NAME, text));
        }
    }
    Ok((seen == triple.len()).then_some(triple))
}

/// The three numbers behind each vertex as normals, if they can be nothing else: they have length 1 (or 0), and colours are never negative.
fn unannounced_normals(behind: &[[f64; 3]], layout: Layout, mesh: &Mesh) -> Option<Vec<[f64; 3]>> {
    let announced = layout.normals || layout.colours || layout.texture;
    if announced || behind.len() != mesh.vertices.len() || !behind.iter().flatten().any(|x| *x < 0.0) {
        return None;
    }
    let length = |[x, y, z]: &[f64; 3]| (x * x + y * y + z * z).sqrt();
    let fits = |normal: &[f64; 3]| *normal == [0.0; 3] || LENGTH_OF_NORMALS.contains(&length(normal));
    behind.iter().all(fits).then(|| behind.iter().map(|normal| normalised(*normal, 0.0).unwrap_or_default()).collect())
}

fn read_face(words: &mut Words<'_>, vertices: u64, faces: &mut Vec<[u32; 3]>) -> Result<(), FormatError> {
    let corners = words.whole_here("the number of corners of a face")?;
    let mut corner = || {
        let place = words.whole_here("a vertex of a face, counted from 0, as many as the first number of the line says")?;
        let here = u32::try_from(place).ok().filter(|_| place < vertices);
        here.ok_or_else(|| {
            let text =
                format!("a face has the vertex {place}, but there are {vertices}, counted from 0; correct it, or the number of vertices");
            words.wrong(text)
        })
    };
    if corners > 0 {
        let first = corner()?;
        let mut last = None;
        for _ in 1..corners {
            let next = corner()?;
            if let Some(last) = last {
                faces.push([first, last, next]);
            }
            last = Some(next);
        }
    }
    words.leave_line();
    Ok(())
}

/// Writes a surface or a cloud of points, NOFF if it has normals. Numbers have the fewest digits that read back as the same number.
///
/// # Errors
/// Unsupported: normals that are not as many as vertices, coordinates that are no numbers, faces with vertices that are not there.
/// Or an I/O error of `out`.
pub fn write_mesh(mesh: &Mesh, out: &mut dyn Write) -> Result<(), FormatError> {
    let refuse = |text: String| Err(FormatError::unsupported(NAME, Place::Whole, text));
    if !mesh.normals.is_empty() && mesh.normals.len() != mesh.vertices.len() {
        return refuse(format!(
            "{} normals for {} vertices; there has to be one for each, or none",
            mesh.normals.len(),
            mesh.vertices.len()
        ));
    }
    if let Some(at) = mesh.vertices.iter().chain(&mesh.normals).position(|v| !v.iter().all(|x| x.is_finite())) {
        return refuse(format!("vertex {} has a coordinate that is no number", at % mesh.vertices.len().max(1)));
    }
    if let Some(face) = mesh.faces.iter().find(|face| face.iter().any(|&v| v as usize >= mesh.vertices.len())) {
        return refuse(format!("the face {face:?} has a vertex that is not among {}", mesh.vertices.len()));
    }
    let mut out = BufWriter::with_capacity(1 << 16, out);
    write_all(mesh, &mut out).and_then(|()| out.flush()).map_err(|e| FormatError::io(NAME, e))
}

fn write_all(mesh: &Mesh, out: &mut dyn Write) -> io::Result<()> {
    let word = if mesh.normals.is_empty() { "OFF" } else { "NOFF" };
    writeln!(out, "{word}\n{} {} 0", mesh.vertices.len(), mesh.faces.len())?;
    let mut normals = mesh.normals.iter();
    for vertex in &mesh.vertices {
        let [x, y, z] = vertex.map(|x| x + 0.0); // no "-0"
        write!(out, "{x} {y} {z}")?;
        if let Some(normal) = normals.next() {
            let [x, y, z] = normal.map(|x| x + 0.0);
            write!(out, " {x} {y} {z}")?;
        }
        writeln!(out)?;
    }
    for [a, b, c] in &mesh.faces {
        writeln!(out, "3 {a} {b} {c}")?;
    }
    Ok(())
}
