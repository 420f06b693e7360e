//! The text of an IES file: LM-63 in its editions of 1986, 1991, 1995, 2002 and 2019.

use std::fmt;

/// What is wrong with an IES file, and where.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct IesFault {
    /// Line, counted from 1.
    pub line: usize,
    /// The complaint.
    pub what: String,
}

impl fmt::Display for IesFault {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "line {}: {}", self.line, self.what)
    }
}

type Parsed<T> = Result<T, IesFault>;

fn fault<T>(line: usize, what: impl Into<String>) -> Parsed<T> {
    Err(IesFault { line, what: what.into() })
}

/// How the two angles of a file span the sphere [LM63].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Photometry {
    /// Planes through a horizontal axis along the luminaire's length: headlights and signals.
    A,
    /// Planes through a horizontal axis along the luminaire's width: floodlights.
    B,
    /// Planes through the vertical axis: nearly everything else.
    C,
}

/// The content of a file: absolute candela on a grid.
pub(super) struct Content {
    pub photometry: Photometry,
    /// Degrees, ascending.
    pub vertical: Vec<f64>,
    /// Degrees, ascending.
    pub horizontal: Vec<f64>,
    /// Candela with all factors of the file, the vertical angles of the first horizontal angle
    /// first.
    pub candela: Vec<f64>,
    /// Angles of tilt in degrees, ascending, and the factors on the light of a lamp so tilted;
    /// empty if that does not matter.
    pub tilt: Vec<(f64, f64)>,
}

/// The rest of the file, number by number.
struct Numbers<'a> {
    tokens: std::iter::Peekable<Box<dyn Iterator<Item = (usize, &'a str)> + 'a>>,
    /// Where the last number stood.
    line: usize,
}

impl<'a> Numbers<'a> {
    /// The numbers of `lines`, the first of which is line `first` of the file.
    fn new(lines: &'a [&'a str], first: usize) -> Self {
        // Files from DOS may end with control-Z.
        let separates = |c: char| c.is_whitespace() || c == ',' || c == '\u{1a}';
        let split = move |(i, line): (usize, &'a &'a str)| {
            line.split(separates).filter(|t| !t.is_empty()).map(move |token| (first + i, token))
        };
        let tokens: Box<dyn Iterator<Item = (usize, &'a str)> + 'a> =
            Box::new(lines.iter().enumerate().flat_map(split));
        Self { tokens: tokens.peekable(), line: first.max(2) - 1 }
    }

    fn next(&mut self, what: impl Fn() -> String) -> Parsed<f64> {
        let Some((line, token)) = self.tokens.next() else {
            return fault(self.line, format!("the file ends before {}", what()));
        };
        self.line = line;
        match token.parse::<f64>() {
            Ok(x) if x.is_finite() => Ok(x),
            _ => fault(line, format!("{} must be a number, and is {:.40?}", what(), token)),
        }
    }

    fn count(&mut self, what: &str) -> Parsed<usize> {
        let x = self.next(|| what.to_owned())?;
        if x.fract() == 0.0 && (1.0..=1e6).contains(&x) {
            return Ok(x as usize);
        }
        fault(self.line, format!("{what} must be a whole number of at least 1, and is {x}"))
    }

    fn factor(&mut self, what: &str) -> Parsed<f64> {
        let x = self.next(|| what.to_owned())?;
        if x >= 0.0 {
            Ok(x)
        } else {
            fault(self.line, format!("{what} must not be negative, and is {x}"))
        }
    }

    fn series(&mut self, count: usize, what: &str) -> Parsed<Vec<f64>> {
        (1..=count).map(|i| self.next(|| format!("{what} {i} of {count}"))).collect()
    }

    fn angles(&mut self, count: usize, what: &str, low: f64, high: f64) -> Parsed<Vec<f64>> {
        let mut angles: Vec<f64> = Vec::new();
        for i in 1..=count {
            let angle = self.next(|| format!("{what} {i} of {count}"))?;
            if angle < low || angle > high {
                return fault(
                    self.line,
                    format!("{what} {i} of {count} is {angle}, and must be from {low} to {high}"),
                );
            }
            if let Some(previous) = angles.last().filter(|p| **p >= angle) {
                return fault(
                    self.line,
                    format!(
                        "{what} {i} of {count} is {angle} after {previous}: the angles must ascend"
                    ),
                );
            }
            angles.push(angle);
        }
        Ok(angles)
    }

    /// The lamp's position, the number of pairs, the angles and the factors of TILT.
    fn tilt(&mut self) -> Parsed<Vec<(f64, f64)>> {
        let position = self.count("the lamp-to-luminaire geometry")?;
        if position > 3 {
            return fault(
                self.line,
                format!("the lamp-to-luminaire geometry must be 1, 2 or 3, and is {position}"),
            );
        }
        let count = self.count("the number of tilt angles")?;
        let angles = self.angles(count, "tilt angle", 0.0, 180.0)?;
        let factors = (1..=count)
            .map(|i| self.factor(&format!("tilt factor {i} of {count}")))
            .collect::<Parsed<Vec<f64>>>()?;
        Ok(angles.into_iter().zip(factors).collect())
    }

    fn end(&mut self) -> Parsed<()> {
        match self.tokens.peek() {
            None => Ok(()),
            Some((line, token)) => fault(
                *line,
                format!("{token:.40?} stands behind the last value, so the counts are wrong"),
            ),
        }
    }
}

/// The light of the lamp in a file of 1986 to 1995 is multiplied by a third factor, which later
/// editions put to other use.
fn has_lamp_factor(first_line: &str) -> bool {
    let line = first_line.to_ascii_uppercase();
    let name = line.strip_prefix("IESNA").or_else(|| line.strip_prefix("IES"));
    name.is_none_or(|rest| {
        ["91", ":LM-63-1986", ":LM-63-1991", ":LM-63-1995", ":LM-63-95"]
            .iter()
            .any(|e| rest.starts_with(e))
    })
}

/// The lines of a file, whatever ends them; bytes that are no UTF-8 can stand in descriptions only.
fn lines(text: &str) -> Vec<&str> {
    text.split('\n')
        .map(|l| l.strip_suffix('\r').unwrap_or(l))
        .flat_map(|l| l.split('\r'))
        .collect()
}

/// Reads a file; `tilt_file` gets the bytes of the file that TILT may name, or says why it cannot.
pub(super) fn parse(
    bytes: &[u8], tilt_file: &dyn Fn(&str) -> Result<Vec<u8>, String>,
) -> Parsed<Content> {
    let text = String::from_utf8_lossy(bytes);
    let lines = lines(&text);
    let is_tilt = |line: &&str| {
        line.trim_start().get(..4).is_some_and(|start| start.eq_ignore_ascii_case("TILT"))
    };
    let Some(at) = lines.iter().position(is_tilt) else {
        return fault(lines.len(), "there is no line TILT=, which every IES file has");
    };
    let Some((_, tilt)) = lines[at].split_once('=') else {
        return fault(at + 1, "TILT must be followed by = and NONE, INCLUDE or the name of a file");
    };
    let mut numbers = Numbers::new(&lines[at + 1..], at + 2);
    let tilt = match tilt.trim() {
        none if none.eq_ignore_ascii_case("NONE") => Vec::new(),
        include if include.eq_ignore_ascii_case("INCLUDE") => numbers.tilt()?,
        "" => {
            return fault(at + 1, "TILT= must be followed by NONE, INCLUDE or the name of a file");
        }
        name => external_tilt(name, tilt_file)
            .or_else(|what| fault(at + 1, format!("TILT={name}: {what}")))?,
    };

    numbers.count("the number of lamps")?;
    let lumens = numbers.next(|| "the lumens per lamp".to_owned())?;
    if lumens < 0.0 && lumens != -1.0 {
        return fault(
            numbers.line,
            format!(
                "the lumens per lamp must be positive, or -1 for absolute photometry, and are {lumens}"
            ),
        );
    }
    let multiplier = numbers.factor("the candela multiplier")?;
    let counts = [
        numbers.count("the number of vertical angles")?,
        numbers.count("the number of horizontal angles")?,
    ];
    let photometry = match numbers.next(|| "the photometric type".to_owned())? {
        1.0 => Photometry::C,
        2.0 => Photometry::B,
        3.0 => Photometry::A,
        other => {
            return fault(
                numbers.line,
                format!("the photometric type must be 1 (C), 2 (B) or 3 (A), and is {other}"),
            );
        }
    };
    let units = numbers.next(|| "the units type".to_owned())?;
    if units != 1.0 && units != 2.0 {
        return fault(
            numbers.line,
            format!("the units type must be 1 (feet) or 2 (metres), and is {units}"),
        );
    }
    // The size of the luminous opening: the light is a point here.
    numbers.series(3, "luminous dimension")?;
    let ballast = numbers.factor("the ballast factor")?;
    let third = numbers.factor("the ballast-lamp photometric factor")?;
    let lamp =
        if has_lamp_factor(lines[0].trim_start_matches('\u{feff}').trim()) { third } else { 1.0 };
    numbers.factor("the input watts")?;

    let (vertical, horizontal) = angles(&mut numbers, photometry, counts)?;
    let scale = multiplier * ballast * lamp;
    let total = counts[0] * counts[1];
    let mut candela = Vec::new();
    for i in 1..=total {
        candela.push(scale * numbers.factor(&format!("candela value {i} of {total}"))?);
    }
    numbers.end()?;
    if !candela.iter().all(|c| *c < 1e30) {
        return fault(numbers.line, "the candela values are too large");
    }
    Ok(Content { photometry, vertical, horizontal, candela, tilt })
}

fn external_tilt(
    name: &str, tilt_file: &dyn Fn(&str) -> Result<Vec<u8>, String>,
) -> Result<Vec<(f64, f64)>, String> {
    let bytes = tilt_file(name)?;
    let text = String::from_utf8_lossy(&bytes);
    let lines = lines(&text);
    let mut numbers = Numbers::new(&lines, 1);
    let tilt = numbers.tilt().map_err(|fault| fault.to_string())?;
    numbers.end().map_err(|fault| fault.to_string())?;
    Ok(tilt)
}

/// The vertical and the horizontal angles.
fn angles(
    numbers: &mut Numbers, photometry: Photometry, counts: [usize; 2],
) -> Parsed<(Vec<f64>, Vec<f64>)> {
    if photometry != Photometry::C {
        let vertical = numbers.angles(counts[0], "vertical angle", -90.0, 90.0)?;
        let horizontal = numbers.angles(counts[1], "horizontal angle", -90.0, 90.0)?;
        if counts.contains(&1) {
            return fault(
                numbers.line,
                "photometry of type A and B needs two or more angles each way",
            );
        }
        return Ok((vertical, horizontal));
    }
    let vertical = numbers.angles(counts[0], "vertical angle", 0.0, 180.0)?;
    if counts[0] == 1 {
        return fault(numbers.line, "there must be two or more vertical angles");
    }
    let horizontal = numbers.angles(counts[1], "horizontal angle", 0.0, 360.0)?;
    let (first, last) = (horizontal[0], horizontal[counts[1] - 1]);
    let known = counts[1] == 1
        || (first == 0.0 && (last == 90.0 || last >= 180.0))
        || (first == 90.0 && last == 270.0);
    if !known {
        let what = "the horizontal angles of type C must be 0 alone, or from 0 to 90, to 180 or beyond, or from 90 to 270";
        return fault(numbers.line, format!("{what}; they are from {first} to {last}"));
    }
    Ok((vertical, horizontal))
}
