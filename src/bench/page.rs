//! A report as one HTML file with everything in it.

use super::report::{Report, Row};
use crate::error::{Error, Result};
use std::fmt::Write;
use std::path::Path;

/// Size of the diagram, and its margins.
const DIAGRAM: [f64; 2] = [720.0, 420.0];
const MARGIN: f64 = 60.0;
const COLORS: [&str; 10] = [
    "#1f77b4", "#d62728", "#2ca02c", "#9467bd", "#ff7f0e", "#17becf", "#8c564b", "#e377c2",
    "#7f7f7f", "#bcbd22",
];

/// The page of `report`, whose pictures lie in `folder`.
///
/// # Errors
/// [`Error::Io`] naming a picture that cannot be read.
pub fn html(report: &Report, folder: &Path) -> Result<String> {
    let mut page = format!(
        "<!DOCTYPE html>\n<html lang=\"en\"><meta charset=\"utf-8\"><title>{title}</title>\n<style>body{{font:15px sans-serif;margin:2em}}table{{border-collapse:collapse}}\
         td,th{{padding:3px 10px;text-align:right;border-bottom:1px solid #ccc}}td:first-child,th:first-child{{text-align:left}}figure{{display:inline-block;margin:6px}}\
         figcaption{{font-size:13px}}</style>\n<h1>{title}</h1>\n<p>Indirect irradiance at {points} shading points ({w}x{h} pixels); {rays} rays per record; {reference}. \
         relMSE is the mean of (x - r)&sup2;/(r&sup2; + 0.01). Own errors are what is left without the noise of the reference.</p>\n",
        title = escape(&report.title),
        points = report.points,
        w = report.size[0],
        h = report.size[1],
        rays = report.rays,
        reference = match (report.reference_rays, report.noise) {
            (0, _) => "reference from a file".to_owned(),
            (n, Some(noise)) => format!(
                "reference by {n} path-traced rays per pixel, whose own relMSE is {noise:.2e}"
            ),
            (n, None) => format!("reference by {n} path-traced rays per pixel"),
        },
    );
    page += "<table><tr><th>preset<th>wanted<th>records<th>error<th>passes<th>fill, s<th>RMSE<th>relMSE<th>own RMSE<th>own relMSE<th>MAPE<th>mean</tr>\n";
    for r in &report.rows {
        let optional = |x: Option<f64>| x.map_or_else(|| "-".to_owned(), |x| format!("{x:.3e}"));
        let mean = r.mean_ratio.map_or_else(|| "-".to_owned(), |m| format!("{m:.4}"));
        let star = if r.equal { "" } else { "*" };
        // Writing to a string cannot fail, here and below.
        let _ = writeln!(
            page,
            "<tr><td>{}<td>{}<td>{}{star}<td>{:.3e}<td>{}<td>{:.1}<td>{:.3e}<td>{:.3e}<td>{}<td>{}<td>{:.2} %<td>{mean}</tr>",
            escape(&r.preset),
            r.wanted,
            r.records,
            r.error,
            r.passes,
            r.seconds,
            r.rmse,
            r.relmse,
            optional(r.own_rmse),
            optional(r.own_relmse),
            100.0 * r.mape
        );
    }
    page += "</table>\n";
    if report.rows.iter().any(|r| !r.equal) {
        page +=
            "<p>* more than 5 % from the wanted number: no error that was tried gives it.</p>\n";
    }
    page += &diagram(report);
    page += "<h2>Pictures</h2>\n";
    figure(&mut page, folder, "reference.png", "reference")?;
    page += "<br>\n";
    for r in &report.rows {
        figure(&mut page, folder, &r.picture, &format!("{}, {} records", r.preset, r.records))?;
        figure(&mut page, folder, &r.difference, "its difference, fourfold")?;
    }
    Ok(page + "</html>\n")
}

/// relMSE over the number of records, both logarithmic.
fn diagram(report: &Report) -> String {
    let mut presets: Vec<&str> = report.rows.iter().map(|r| r.preset.as_str()).collect();
    presets.dedup();
    let range = |value: &dyn Fn(&Row) -> f64| {
        let (a, b) = report
            .rows
            .iter()
            .map(|r| value(r).max(1e-12).log10())
            .fold((f64::MAX, f64::MIN), |(a, b), v| (a.min(v), b.max(v)));
        if b - a > 0.05 { (a, b) } else { (a - 0.1, b + 0.1) }
    };
    let records = |r: &Row| r.records as f64;
    let relmse = |r: &Row| r.relmse;
    let ((x0, x1), (y0, y1)) = (range(&records), range(&relmse));
    let [w, h] = DIAGRAM;
    let place = |r: &Row| {
        let x = MARGIN + (records(r).max(1e-12).log10() - x0) / (x1 - x0) * (w - 3.5 * MARGIN);
        let y = h - MARGIN - (relmse(r).max(1e-12).log10() - y0) / (y1 - y0) * (h - 2.0 * MARGIN);
        (x, y)
    };
    let mut svg = format!(
        "<h2>relMSE over the number of records</h2>\n<svg width=\"{w}\" height=\"{h}\" font-size=\"12\">\n"
    );
    for (at, (x, y)) in [(10f64.powf(y0), (4.0, h - MARGIN)), (10f64.powf(y1), (4.0, MARGIN))] {
        let _ = writeln!(svg, "<text x=\"{x}\" y=\"{y}\">{at:.1e}</text>");
    }
    for (at, x) in [(10f64.powf(x0), MARGIN), (10f64.powf(x1), w - 2.5 * MARGIN)] {
        let _ = writeln!(svg, "<text x=\"{x}\" y=\"{}\">{at:.0}</text>", h - 0.5 * MARGIN);
    }
    for (k, preset) in presets.iter().enumerate() {
        let color = COLORS[k % COLORS.len()];
        let points: Vec<(f64, f64)> =
            report.rows.iter().filter(|r| r.preset == *preset).map(place).collect();
        let line: String = points.iter().map(|(x, y)| format!("{x:.1},{y:.1} ")).collect();
        let _ = writeln!(
            svg,
            "<polyline points=\"{line}\" fill=\"none\" stroke=\"{color}\" stroke-width=\"2\"/>"
        );
        for (x, y) in points {
            let _ = writeln!(svg, "<circle cx=\"{x:.1}\" cy=\"{y:.1}\" r=\"3\" fill=\"{color}\"/>");
        }
        let y = MARGIN + 18.0 * k as f64;
        let _ = writeln!(
            svg,
            "<text x=\"{}\" y=\"{y}\" fill=\"{color}\">{}</text>",
            w - 2.2 * MARGIN,
            escape(preset)
        );
    }
    svg + "</svg>\n"
}

fn figure(page: &mut String, folder: &Path, file: &str, caption: &str) -> Result<()> {
    let path = folder.join(file);
    let bytes = std::fs::read(&path).map_err(Error::io(&path))?;
    let _ = writeln!(
        page,
        "<figure><img src=\"data:image/png;base64,{}\" alt=\"\"><figcaption>{}</figcaption></figure>",
        base64(&bytes),
        escape(caption)
    );
    Ok(())
}

fn escape(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;").replace('"', "&quot;")
}

/// Bytes in the alphabet of RFC 4648, padded.
fn base64(bytes: &[u8]) -> String {
    const ALPHABET: &[u8; 64] = b"ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    let mut text = String::with_capacity(bytes.len().div_ceil(3) * 4);
    for three in bytes.chunks(3) {
        let word = three.iter().fold(0, |w, b| w << 8 | u32::from(*b)) << (8 * (3 - three.len()));
        for k in 0..4 {
            let digit = ALPHABET[(word >> (18 - 6 * k) & 63) as usize];
            text.push(if k <= three.len() { char::from(digit) } else { '=' });
        }
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn base64_of_the_standard_s_examples() {
        for (plain, coded) in [
            ("", ""),
            ("f", "Zg=="),
            ("fo", "Zm8="),
            ("foo", "Zm9v"),
            ("foob", "Zm9vYg=="),
            ("fooba", "Zm9vYmE="),
            ("foobar", "Zm9vYmFy"),
        ] {
            assert_eq!(base64(plain.as_bytes()), coded);
        }
    }
}
