//! A report as one HTML file with everything in it.

use super::report::{Report, Row};
use crate::error::{Error, Result};
use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use maud::{DOCTYPE, Markup, PreEscaped, html};
use plotters::prelude::*;
use std::ops::Range;
use std::path::Path;

const STYLE: &str = "body { font: 15px sans-serif; margin: 2em }
table { border-collapse: collapse }
td, th { padding: 3px 10px; text-align: right; border-bottom: 1px solid #ccc }
td:first-child, th:first-child { text-align: left }
figure { display: inline-block; margin: 6px }
figcaption { font-size: 13px }";
const HEADINGS: [&str; 12] = [
    "preset",
    "wanted",
    "records",
    "error",
    "passes",
    "fill, s",
    "RMSE",
    "relMSE",
    "own RMSE",
    "own relMSE",
    "MAPE",
    "mean",
];
const NOT_EQUAL: &str = "* more than 5 % from the wanted number: no error that was tried gives it.";
/// Size of the diagram in pixels.
const DIAGRAM: (u32, u32) = (820, 440);
/// Room for the names of the presets, right of the curves.
const NAMES: u32 = 200;

/// The page of `report`, whose pictures lie in `folder`.
///
/// # Errors
/// [`Error::Io`] naming a picture that cannot be read.
pub fn html(report: &Report, folder: &Path) -> Result<String> {
    let reference = match (report.reference_rays, report.noise) {
        (0, _) => "reference from a file".to_owned(),
        (n, Some(noise)) => {
            format!("reference by {n} path-traced rays per pixel, whose own relMSE is {noise:.2e}")
        }
        (n, None) => format!("reference by {n} path-traced rays per pixel"),
    };
    let [width, height] = report.size;
    let mut pictures = vec![figure(folder, "reference.png", "reference")?];
    for r in &report.rows {
        let caption = format!("{}, {} records", r.preset, r.records);
        pictures.push(figure(folder, &r.picture, &caption)?);
        pictures.push(figure(folder, &r.difference, "its difference, fourfold")?);
    }
    let page = html! {
        (DOCTYPE)
        html lang="en" {
            head {
                meta charset="utf-8";
                title { (report.title) }
                style { (PreEscaped(STYLE)) }
            }
            body {
                h1 { (report.title) }
                p {
                    "Indirect irradiance at " (report.points) " shading points "
                    "(" (width) "x" (height) " pixels); " (report.rays) " rays per record; "
                    (reference) ". relMSE is the mean of (x - r)²/(r² + 0.01). "
                    "Own errors are what is left without the noise of the reference."
                }
                table {
                    tr { @for heading in HEADINGS { th { (heading) } } }
                    @for r in &report.rows { (row(r)) }
                }
                @if report.rows.iter().any(|r| !r.equal) {
                    p { (NOT_EQUAL) }
                }
                h2 { "relMSE over the number of records" }
                (PreEscaped(diagram(report)?))
                h2 { "Pictures" }
                @for (k, picture) in pictures.iter().enumerate() {
                    (picture)
                    @if k == 0 { br; }
                }
            }
        }
    };
    Ok(page.into_string())
}

fn row(r: &Row) -> Markup {
    let optional = |x: Option<f64>| x.map_or_else(|| "-".to_owned(), |x| format!("{x:.3e}"));
    let cells = [
        r.preset.clone(),
        r.wanted.to_string(),
        format!("{}{}", r.records, if r.equal { "" } else { "*" }),
        format!("{:.3e}", r.error),
        r.passes.to_string(),
        format!("{:.1}", r.seconds),
        format!("{:.3e}", r.rmse),
        format!("{:.3e}", r.relmse),
        optional(r.own_rmse),
        optional(r.own_relmse),
        format!("{:.2} %", 100.0 * r.mape),
        r.mean_ratio.map_or_else(|| "-".to_owned(), |m| format!("{m:.4}")),
    ];
    html! { tr { @for cell in cells { td { (cell) } } } }
}

fn figure(folder: &Path, file: &str, caption: &str) -> Result<Markup> {
    let path = folder.join(file);
    let bytes = std::fs::read(&path).map_err(Error::io(&path))?;
    let source = format!("data:image/png;base64,{}", STANDARD.encode(bytes));
    Ok(html! { figure { img src=(source) alt=""; figcaption { (caption) } } })
}

/// relMSE over the number of records, both logarithmic, as SVG.
fn diagram(report: &Report) -> Result<String> {
    let mut svg = String::new();
    plot(report, &mut svg).map_err(|e| Error::Device(format!("the diagram: {e}")))?;
    Ok(svg)
}

fn plot(report: &Report, svg: &mut String) -> std::result::Result<(), Box<dyn std::error::Error>> {
    // The axes hold logarithms: plotters' own logarithmic axis has no labels within a decade.
    let place = |r: &Row| ((r.records.max(1) as f64).log10(), r.relmse.max(1e-12).log10());
    let (x, y) = report.rows.iter().map(place).unzip();
    let root = SVGBackend::with_string(svg, DIAGRAM).into_drawing_area();
    let mut chart = ChartBuilder::on(&root)
        .margin(10)
        .margin_right(NAMES)
        .x_label_area_size(40)
        .y_label_area_size(70)
        .build_cartesian_2d(range(x), range(y))?;
    chart
        .configure_mesh()
        .max_light_lines(1)
        .x_desc("records")
        .y_desc("relMSE")
        .x_label_formatter(&|v| format!("{:.0}", 10_f64.powf(*v)))
        .y_label_formatter(&|v| format!("{:.1e}", 10_f64.powf(*v)))
        .draw()?;
    for (k, rows) in report.rows.chunk_by(|a, b| a.preset == b.preset).enumerate() {
        let color = Palette99::pick(k).to_rgba();
        let line = LineSeries::new(rows.iter().map(place), color.stroke_width(2)).point_size(3);
        chart.draw_series(line)?;
        let name = ("sans-serif", 14).into_font().color(&color);
        let at = ((DIAGRAM.0 - NAMES) as i32 + 8, 20 + 18 * k as i32);
        root.draw(&Text::new(rows[0].preset.as_str(), at, name))?;
    }
    root.present()?;
    Ok(())
}

/// From the least to the largest value, with some room around a single one.
fn range(values: Vec<f64>) -> Range<f64> {
    let finite = values.into_iter().filter(|v| v.is_finite());
    let (a, b) = finite.fold((f64::MAX, f64::MIN), |(a, b), v| (a.min(v), b.max(v)));
    match b - a {
        width if width > 0.05 => a - 0.04 * width..b + 0.04 * width,
        width if width >= 0.0 => a - 0.1..b + 0.1,
        _ => 0.0..1.0,
    }
}
