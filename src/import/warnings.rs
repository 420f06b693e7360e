//! What the user should know of a file that loads all the same.

use super::fault::{Fault, Parsed};
use crate::error::one_line;
use std::collections::HashMap;

/// Warnings, of which those of a kind are counted.
#[derive(Debug, Default)]
pub(super) struct Warnings {
    strict: bool,
    /// The first of each kind, and how many there are.
    kinds: Vec<(String, usize)>,
    /// Where a kind stands among them.
    places: HashMap<String, usize>,
}

impl Warnings {
    /// No warnings yet; a `strict` list takes none of what breaks the specification.
    pub fn new(strict: bool) -> Self {
        Self { strict, ..Self::default() }
    }

    /// What could be mended is an error.
    pub fn is_strict(&self) -> bool {
        self.strict
    }

    /// The file is sound, and not everything of it is shown.
    pub fn push(&mut self, text: impl AsRef<str>) {
        let text = text.as_ref();
        let place = *self.places.entry(kind(text)).or_insert(self.kinds.len());
        match self.kinds.get_mut(place) {
            Some((_, count)) => *count += 1,
            None => self.kinds.push((one_line(text), 1)),
        }
    }

    /// What stands at the JSON path `at` breaks the specification and is mended as `what` says: an
    /// error if the caller is strict.
    pub fn mend(&mut self, at: &str, what: impl AsRef<str>) -> Parsed<()> {
        if self.strict {
            return Err(Fault::new(at, what.as_ref()));
        }
        self.push(if at.is_empty() {
            what.as_ref().to_owned()
        } else {
            format!("{at}: {}", what.as_ref())
        });
        Ok(())
    }

    /// As [`Warnings::mend`], for what changes nothing: no warning.
    pub fn allow(&mut self, at: &str, what: &str) -> Parsed<()> {
        if self.strict { self.mend(at, what) } else { Ok(()) }
    }

    /// One line for each kind.
    pub fn lines(self) -> Vec<String> {
        let line = |(text, count): (String, usize)| match count {
            1 => text,
            _ => format!("{text} (and {} more like it)", count - 1),
        };
        self.kinds.into_iter().map(line).collect()
    }
}

/// A text without its numbers and quotations, which differ between warnings of a kind.
fn kind(text: &str) -> String {
    let (mut kind, mut quoted, mut last) = (String::new(), false, ' ');
    for c in text.chars() {
        let number = c.is_ascii_digit() || ".+-".contains(c) || (c == 'e' && last == '0');
        if c == '"' && last != '\\' {
            quoted = !quoted;
        } else if !quoted && !number {
            kind.push(c);
        }
        last = if number { '0' } else { c };
    }
    kind
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn warnings_of_a_kind_are_counted() {
        let mut warnings = Warnings::new(false);
        for i in 0..42 {
            warnings.mend(&format!("/materials/{i}/ior"), format!("{}e-7 is low", i)).unwrap();
            warnings.push(format!("/nodes/{i} (\"a\\\"{i}\"): left out"));
        }
        warnings.push("\u{1b}[2J\n");
        assert_eq!(
            warnings.lines(),
            [
                "/materials/0/ior: 0e-7 is low (and 41 more like it)",
                "/nodes/0 (\"a\\\"0\"): left out (and 41 more like it)",
                "\\u{1b}[2J\\n"
            ]
        );
        assert_eq!(Warnings::new(true).mend("/a", "b"), Err(Fault::new("/a", "b")));
    }
}
