//! How text is set for whoever reads it: how wide, in which colours, with which characters.
//!
//! What is told is composed elsewhere; here is what a terminal, a pipe, or somebody who said `NO_COLOR` makes of it.

use anstyle::{AnsiColor, Style as Ansi};
use std::io::{IsTerminal, Stderr, Stdout};
use unicode_width::UnicodeWidthStr;

/// Sentences are no wider than this, however wide the terminal is.
pub const COLUMNS: usize = 80;

/// Narrower terminals are written to as if they had this many columns.
pub const LEAST_COLUMNS: usize = 40;

/// Columns that a word at the start of a line takes, such as `take` or `gaps`, with the blanks around it.
const HEAD: usize = 13;

/// How text is set.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Style {
    /// Columns of the terminal; [`COLUMNS`] where there is none.
    pub columns: usize,
    /// Colours and weights are wanted.
    pub colour: bool,
    /// Nothing but ASCII is to be drawn. Names stay as they are.
    pub ascii: bool,
}

/// What a piece of text is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Tone {
    /// A title.
    Title,
    /// What can be looked past.
    Quiet,
    /// What is to be looked at.
    Look,
    /// What was not done.
    Alarm,
}

/// True if the terminal says that it draws nothing but text.
pub fn is_dumb() -> bool {
    std::env::var_os("TERM").is_some_and(|term| term == "dumb")
}

/// No colours for a terminal that draws nothing but text, also where `CI` says that colours are welcome; to be called before anything is written.
pub fn settle_colours() {
    let forced = std::env::var_os("CLICOLOR_FORCE").is_some_and(|said| !said.is_empty() && said != "0");
    if is_dumb() && !forced {
        anstream::ColorChoice::Never.write_global();
    }
}

impl Style {
    /// For a file or a test: no colours, any characters.
    pub fn plain() -> Self {
        Self { columns: COLUMNS, colour: false, ascii: false }
    }

    /// As standard output wants it.
    pub fn of_stdout() -> Self {
        let out = std::io::stdout();
        let columns = if out.is_terminal() { columns_of(terminal_size::terminal_size_of(&out)) } else { COLUMNS };
        Self { columns, colour: anstream::AutoStream::<Stdout>::choice(&out) != anstream::ColorChoice::Never, ascii: !speaks_utf8() }
    }

    /// As standard error wants it.
    pub fn of_stderr() -> Self {
        let out = std::io::stderr();
        let columns = if out.is_terminal() { columns_of(terminal_size::terminal_size_of(&out)) } else { COLUMNS };
        Self { columns, colour: anstream::AutoStream::<Stderr>::choice(&out) != anstream::ColorChoice::Never, ascii: !speaks_utf8() }
    }

    /// The most columns for sentences.
    pub fn text_columns(&self) -> usize {
        self.columns.clamp(LEAST_COLUMNS, COLUMNS)
    }

    /// Text in the colours of its tone.
    pub fn toned(&self, tone: Tone, text: &str) -> String {
        if !self.colour || text.is_empty() {
            return text.to_owned();
        }
        let ansi = match tone {
            Tone::Title => Ansi::new().bold(),
            Tone::Quiet => Ansi::new().dimmed(),
            Tone::Look => Ansi::new().bold().fg_color(Some(AnsiColor::Yellow.into())),
            Tone::Alarm => Ansi::new().bold().fg_color(Some(AnsiColor::Red.into())),
        };
        format!("{ansi}{text}{ansi:#}")
    }

    /// A word and what it says, as lines: the text is wrapped and stands beside the word.
    pub fn item(&self, head: &str, text: &str) -> String {
        self.under(head, &wrap(text, self.text_columns().saturating_sub(HEAD)))
    }

    /// A sentence on lines of its own, the further ones indented.
    pub fn sentence(&self, text: &str) -> String {
        let lines = wrap(text, self.text_columns() - 4);
        lines.iter().enumerate().fold(String::new(), |text, (at, line)| text + if at > 0 { "    " } else { "  " } + line + "\n")
    }

    /// The same for the name of a file, which stays in one piece.
    pub fn name(&self, head: &str, name: &str) -> String {
        self.under(head, &[name.to_owned()])
    }

    fn under(&self, head: &str, lines: &[String]) -> String {
        let tone = match head {
            "open" | "no log" => Tone::Alarm,
            "look at" | "not kept" => Tone::Look,
            _ => Tone::Quiet,
        };
        let mut out = String::new();
        for (at, line) in lines.iter().enumerate() {
            let head = if at == 0 { head } else { "" };
            let blank = " ".repeat((HEAD - 2).saturating_sub(columns(head)));
            out.push_str(format!("  {}{blank}{line}", self.toned(tone, head)).trim_end());
            out.push('\n');
        }
        out
    }

    /// `from -> to`, on two lines where one is too short.
    pub fn way(&self, from: &str, to: &str) -> String {
        let whole = format!("{from} -> {to}");
        let lines = if columns(&whole) <= self.text_columns() { vec![whole] } else { vec![from.to_owned(), format!("  -> {to}")] };
        lines.iter().map(|line| self.toned(Tone::Title, line) + "\n").collect()
    }
}

fn columns_of(size: Option<(terminal_size::Width, terminal_size::Height)>) -> usize {
    // a pseudo-terminal that was never given a size says 0
    size.map(|(terminal_size::Width(width), _)| usize::from(width)).filter(|&width| width > 0).unwrap_or(COLUMNS)
}

/// True if what is drawn may have characters beyond ASCII, by the locale.
fn speaks_utf8() -> bool {
    let said = ["LC_ALL", "LC_CTYPE", "LANG"].map(|name| std::env::var(name).unwrap_or_default());
    // where locales are not said in the environment, the console takes Unicode
    cfg!(windows) || locale_is_utf8(&said)
}

/// The first that says anything decides.
fn locale_is_utf8(said: &[String]) -> bool {
    let locale = said.iter().find(|text| !text.is_empty()).map(|text| text.to_ascii_lowercase()).unwrap_or_default();
    locale.contains("utf-8") || locale.contains("utf8")
}

/// The columns that a text takes on a terminal.
pub fn columns(text: &str) -> usize {
    text.width()
}

/// Breaks a text at blanks into lines of at most `width` columns; a longer word stays whole. Never without a line.
pub fn wrap(text: &str, width: usize) -> Vec<String> {
    let mut lines = vec![String::new()];
    let mut used = 0;
    for (at, word) in words(text).enumerate() {
        let own = columns(word);
        if let Some(line) = lines.last_mut() {
            let begins = at == 0 || used + 1 + own <= width || line.is_empty();
            if begins {
                if at > 0 && !line.is_empty() {
                    line.push(' ');
                    used += 1;
                }
                line.push_str(word);
                used += own;
                continue;
            }
        }
        lines.push(word.to_owned());
        used = own;
    }
    for line in &mut lines {
        line.truncate(line.trim_end().len());
    }
    lines
}

/// The pieces between which a line may end: at blanks, but not between a number and its unit.
fn words(text: &str) -> impl Iterator<Item = &str> {
    let mut rest = Some(text);
    std::iter::from_fn(move || {
        let whole = rest?;
        let mut from = 0;
        while let Some(at) = whole[from..].find(' ').map(|at| from + at) {
            let unit = whole[at + 1..].split([' ', ',', ';', '.', ')', ':']).next().unwrap_or_default();
            if !(UNITS.contains(&unit) && whole[..at].ends_with(|c: char| c.is_ascii_digit())) {
                rest = Some(&whole[at + 1..]);
                return Some(&whole[..at]);
            }
            from = at + 1;
        }
        rest = None;
        Some(whole)
    })
}

/// No name in a table is cut to less.
const LEAST_NAME: usize = 12;

/// Stand on the line of their number.
const UNITS: [&str; 5] = ["mm", "m", "s", "%", "Hz"];

/// A text cut to at most `width` columns; what was cut shows. `ascii` says with which character.
pub fn cut(text: &str, width: usize, ascii: bool) -> String {
    if columns(text) <= width {
        return text.to_owned();
    }
    let mark = if ascii { '~' } else { '…' };
    let (mut kept, mut used) = (String::new(), 1);
    for c in text.chars() {
        let own = columns(c.encode_utf8(&mut [0; 4]));
        if used + own > width {
            break;
        }
        kept.push(c);
        used += own;
    }
    kept.push(mark);
    kept
}

/// A table with its titles: the first column left, the others right. Columns that are too many are left out, as `dispensable` orders them;
/// then what stands in the first one is cut.
pub fn table(titles: &[&str], rows: &[Vec<String>], style: &Style, dispensable: &[usize]) -> Vec<String> {
    let width = style.text_columns();
    let mut widths: Vec<usize> =
        (0..titles.len()).map(|c| rows.iter().map(|row| columns(&row[c])).chain([columns(titles[c])]).max().unwrap_or(0)).collect();
    let mut kept: Vec<usize> = (0..titles.len()).collect();
    let needed = |kept: &[usize]| kept.iter().map(|&c| widths[c] + 2).sum::<usize>();
    for &column in dispensable {
        if needed(&kept) > width {
            kept.retain(|&c| c != column);
        }
    }
    widths[0] = widths[0].saturating_sub(needed(&kept).saturating_sub(width)).max(LEAST_NAME.min(widths[0]));
    let set = |cells: &dyn Fn(usize) -> String| {
        let mut line = String::new();
        for &c in &kept {
            let cell = cut(&cells(c), widths[c], style.ascii);
            let blank = " ".repeat(widths[c].saturating_sub(columns(&cell)));
            line.push_str("  ");
            line.push_str(&if c == 0 { cell + &blank } else { blank + &cell });
        }
        line.trim_end().to_owned()
    };
    let mut lines = vec![set(&|c| titles[c].to_owned())];
    lines.extend(rows.iter().map(|row| set(&|c| row[c].clone())));
    lines
}

/// A time that does not pretend to be known to the second.
pub fn rounded(secs: f64) -> String {
    match secs {
        s if s < 10.0 => format!("{:.0} s", s.ceil().max(1.0)),
        s if s < 100.0 => format!("{:.0} s", (s / 5.0).ceil() * 5.0),
        s if s < 5400.0 => format!("{:.0} min", (s / 60.0).ceil()),
        s if s < 36_000.0 => format!("{:.1} h", s / 3600.0),
        s => format!("{:.0} h", s / 3600.0),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sentences_are_wrapped_at_blanks() {
        for (text, width, lines) in [
            ("", 5, &[""][..]),
            ("a bc def", 4, &["a bc", "def"]),
            ("a bc def", 80, &["a bc def"]),
            ("a toolongword b", 4, &["a", "toolongword", "b"]),
            ("two  blanks", 20, &["two  blanks"]),
            ("worst 31.4 mm (A-B)", 10, &["worst", "31.4 mm", "(A-B)"]),
            ("歩行 データ x", 7, &["歩行", "データ", "x"]),
        ] {
            assert_eq!(wrap(text, width), lines, "{text:?} in {width}");
        }
    }

    #[test]
    fn what_is_cut_shows() {
        for (text, width, shown) in [("LKNE", 4, "LKNE"), ("subject:LKNE", 6, "subje…"), ("歩行データ", 6, "歩行…")] {
            assert_eq!(cut(text, width, false), shown);
            assert!(columns(&cut(text, width, true)) <= width);
        }
        assert_eq!(cut("subject:LKNE", 6, true), "subje~");
    }

    #[test]
    fn items_stand_beside_their_word() {
        let style = Style { columns: 30, ..Style::plain() };
        assert_eq!(
            style.item("look at", "a sentence that has to be wrapped somewhere"),
            "  look at    a sentence that has to be\n             wrapped somewhere\n"
        );
        assert_eq!(Style::plain().name("log", "a  b"), "  log        a  b\n");
        assert_eq!(Style::plain().way("a", "b"), "a -> b\n");
        let long = "x".repeat(60);
        assert_eq!(Style::plain().way(&long, &long), format!("{long}\n  -> {long}\n"));
    }

    #[test]
    fn colours_come_only_when_wanted() {
        assert_eq!(Style::plain().toned(Tone::Alarm, "open"), "open");
        let toned = Style { colour: true, ..Style::plain() }.toned(Tone::Alarm, "open");
        assert!(toned.starts_with('\u{1b}') && toned.contains("open") && toned.ends_with("\u{1b}[0m"), "{toned:?}");
    }

    #[test]
    fn the_locale_says_which_characters() {
        for (said, utf8) in [
            (["", "", ""], false),
            (["", "", "de_DE.UTF-8"], true),
            (["C", "", "de_DE.UTF-8"], false),
            (["", "C.utf8", "POSIX"], true),
            (["en_GB.ISO-8859-1", "", ""], false),
        ] {
            assert_eq!(locale_is_utf8(&said.map(str::to_owned)), utf8, "{said:?}");
        }
    }

    #[test]
    fn tables_leave_out_what_does_not_fit() {
        let rows = [vec!["LKNE".to_owned(), "3".to_owned(), "120".to_owned()]];
        let titles = ["marker", "gaps", "samples"];
        let at = |columns| Style { columns, ..Style::plain() };
        assert_eq!(table(&titles, &rows, &at(80), &[1]), ["  marker  gaps  samples", "  LKNE       3      120"]);
        let rows = [vec!["LKNE_of_the_second_subject".to_owned(), "3".to_owned(), "120".to_owned()]];
        assert_eq!(
            table(&titles, &rows, &at(40), &[1]),
            ["  marker                      samples", "  LKNE_of_the_second_subject      120"]
        );
        assert_eq!(
            table(&titles, &rows, &at(40), &[]),
            ["  marker                   gaps  samples", "  LKNE_of_the_second_sub…     3      120"]
        );
    }

    #[test]
    fn times_are_round() {
        for (secs, said) in [(0.0, "1 s"), (3.2, "4 s"), (12.0, "15 s"), (100.0, "2 min"), (1000.0, "17 min"), (9000.0, "2.5 h")] {
            assert_eq!(rounded(secs), said);
        }
    }
}
