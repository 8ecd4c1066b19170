//! The plot of a scene: error over time, both logarithmic.

use super::results::{Clock, Curve, Point};
use caustica::image_io::replace_file;
use caustica::{Error, Result};
use plotters::element::DashedPathElement;
use plotters::prelude::*;
use std::io::Write;
use std::path::Path;

/// Okabe & Ito 2008: colours that colour-blind readers tell apart.
const COLORS: [RGBColor; 7] = [
    RGBColor(213, 94, 0),
    RGBColor(0, 114, 178),
    RGBColor(0, 158, 115),
    RGBColor(204, 121, 167),
    RGBColor(0, 0, 0),
    RGBColor(86, 180, 233),
    RGBColor(230, 159, 0),
];

const FONT: &str = "sans-serif";

/// Writes the plot of `curves` as SVG. Errors below `floor`, the reference's own, mean little and are shaded.
pub(super) fn write(path: &Path, title: &str, curves: &[&Curve], floor: f64) -> Result<()> {
    let svg =
        draw(title, curves, floor).map_err(|e| Error::Runtime(format!("cannot plot '{title}': {e}")))?;
    replace_file(path, |w| w.write_all(svg.as_bytes()))
}

fn draw(title: &str, curves: &[&Curve], floor: f64) -> Result<String, Box<dyn std::error::Error>> {
    let mut svg = String::new();
    let area = SVGBackend::with_string(&mut svg, (860, 520)).into_drawing_area();
    area.fill(&WHITE)?;
    let shown = |p: &&Point| p.error.min > 0.0 && p.error.max.is_finite();
    let clock = Clock::of(curves);
    let timed = |p: &Point| Some((p.timed(clock)?.seconds, p.error));
    let points = || curves.iter().flat_map(|c| &c.points).filter(shown).filter_map(timed);
    let (x0, x1) = range(points().flat_map(|(s, _)| [s.min, s.max]));
    let (y0, y1) = range(points().flat_map(|(_, e)| [e.min, e.max]));
    let mut chart = ChartBuilder::on(&area)
        .caption(title, (FONT, 20))
        .margin(14)
        .x_label_area_size(42)
        .y_label_area_size(72)
        .build_cartesian_2d((x0..x1).log_scale(), (y0..y1).log_scale())?;
    chart
        .configure_mesh()
        .bold_line_style(BLACK.mix(0.2))
        .light_line_style(TRANSPARENT)
        .label_style((FONT, 14))
        .x_desc(format!("{} seconds, loading included", clock.name()))
        .y_desc("relmse less the reference's own")
        .x_label_formatter(&|x| seconds(*x))
        .y_label_formatter(&|y| format!("{y:.0e}"))
        .draw()?;
    if floor > y0 {
        let corners = [(x0, y0), (x1, floor.min(y1))];
        chart.draw_series([Rectangle::new(corners, BLACK.mix(0.08).filled())])?;
    }
    let mut known: Vec<(&str, &str)> = Vec::new();
    for curve in curves {
        // A method has one colour, whoever traces its rays: its further backends are dashed.
        let method = (curve.method.renderer.as_str(), curve.method.integrator.as_str());
        let index = known.iter().position(|m| *m == method);
        let color = COLORS[index.unwrap_or(known.len()) % COLORS.len()];
        let width = if method.0 == "caustica" { 3 } else { 2 };
        let style = color.stroke_width(width);
        let points = || curve.points.iter().filter(shown).filter_map(timed);
        let line = points().map(|(s, e)| (s.median, e.median));
        let series = match index {
            None => {
                known.push(method);
                chart.draw_series(LineSeries::new(line, style))?
            }
            Some(_) => chart.draw_series(DashedLineSeries::new(line, 6, 4, style))?,
        };
        let gap = if index.is_some() { 4 } else { 0 };
        series
            .label(curve.method.label())
            .legend(move |(x, y)| DashedPathElement::new([(x, y), (x + 22, y)], 6, gap, style));
        // The runs' extremes in error and in time.
        let crosses = points().flat_map(|(s, e)| {
            [[(s.median, e.min), (s.median, e.max)], [(s.min, e.median), (s.max, e.median)]]
        });
        chart.draw_series(crosses.map(|ends| PathElement::new(ends, color.stroke_width(1))))?;
    }
    chart
        .configure_series_labels()
        .position(SeriesLabelPosition::UpperRight)
        .label_font((FONT, 14))
        .background_style(WHITE.mix(0.8))
        .border_style(BLACK.mix(0.2))
        .draw()?;
    area.present()?;
    drop(chart);
    drop(area);
    Ok(svg)
}

/// Every second of a decade would be too crowded.
fn seconds(x: f64) -> String {
    let decade = 10.0_f64.powf(x.log10().floor());
    let digit = (x / decade).round();
    if [1.0, 2.0, 5.0, 10.0].contains(&digit) {
        format!("{}", (x * 1e6).round() / 1e6)
    } else {
        String::new()
    }
}

/// From a little below the smallest to a little above the largest.
fn range(values: impl Iterator<Item = f64>) -> (f64, f64) {
    let (min, max) = values.fold((f64::INFINITY, 0.0_f64), |(a, b), v| (a.min(v), b.max(v)));
    if min <= max { (min / 1.3, max * 1.3) } else { (0.1, 10.0) }
}

#[cfg(test)]
mod tests {
    use super::super::results::tests::run;
    use super::*;

    #[test]
    fn seconds_are_round() {
        let ticks = [0.1 * 3.0, 0.1 * 2.0, 1.0, 0.5, 7.0, 20.000000000000004];
        assert_eq!(ticks.map(seconds), ["", "0.2", "1", "0.5", "", "20"]);
    }

    #[test]
    fn every_curve_is_drawn() {
        let mut rows = run("photonmap", 0, 1e-2);
        rows.extend(run("path", 0, 1e-1));
        let mut broken = run("broken", 0, 1.0);
        broken.iter_mut().for_each(|row| row.relmse = f64::NAN);
        rows.extend(broken);
        let curves = Curve::all(&rows);
        let svg = draw("a <scene>", &curves.iter().collect::<Vec<_>>(), 1e-6).unwrap();
        assert!(
            svg.contains("a &lt;scene&gt;") && svg.contains("caustica path bvh") && svg.ends_with("</svg>\n")
        );
        assert!(svg.matches("<polyline").count() > 2 * 3 * 2, "{svg}");
        assert!(!svg.contains("NaN") && !svg.contains("inf"));
        assert!(svg.contains("CPU seconds"));
        // One that does not tell, and all are drawn by the wall clock.
        rows[0].cpu_seconds = None;
        let curves = Curve::all(&rows);
        let svg = draw("", &curves.iter().collect::<Vec<_>>(), 1e-6).unwrap();
        assert!(svg.contains("wall seconds") && svg.matches("<polyline").count() > 2 * 3 * 2);
        assert!(draw("nothing", &[], 0.0).is_ok());
    }
}
