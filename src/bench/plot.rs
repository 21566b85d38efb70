//! Rows as a bar plot in SVG: a group of horizontal bars per row, one bar per time.

use std::path::Path;

use plotters::prelude::*;
use plotters::style::text_anchor::{HPos, Pos, VPos};

use super::error::BenchError;
use super::report::{NamedTime, Row};
use crate::outfile::{Existing, write_whole};

/// Height of a bar, and of the gap between groups, pixels.
const BAR: u32 = 14;
/// Width of the part that holds the bars, pixels.
const WIDTH: u32 = 640;
/// Height of title, legend and axis together, pixels.
const FRAME: u32 = 90;
/// Width of a character of the labels, pixels, on average.
const CHARACTER: u32 = 7;
/// Colours of the times, in order: distinct in grey, too.
const COLORS: [RGBColor; 4] = [
    RGBColor(31, 90, 150),
    RGBColor(230, 150, 60),
    RGBColor(90, 160, 90),
    RGBColor(150, 90, 140),
];

/// Writes the bars of `rows` (times in milliseconds, unless the rows have others) to `path`, which is replaced when the plot is complete.
///
/// # Errors
/// The plot can't be drawn, or the file can't be written.
pub fn write_plot<R: Row>(rows: &[R], title: &str, path: &Path) -> Result<(), BenchError> {
    let svg = draw(rows, title).map_err(|e| BenchError::Plot {
        path: path.to_owned(),
        reason: e.to_string(),
    })?;
    write_whole(path, Existing::Replace, svg.as_bytes())?;
    Ok(())
}

/// The plot as SVG text.
fn draw<R: Row>(rows: &[R], title: &str) -> Result<String, Box<dyn std::error::Error>> {
    let rows: Vec<(String, Vec<NamedTime>)> = rows
        .iter()
        .map(|row| (row.name(), row.bars()))
        .filter(|(_, bars)| !bars.is_empty())
        .collect();
    let series: Vec<&'static str> = rows
        .first()
        .map_or_else(Vec::new, |(_, bars)| bars.iter().map(|&(n, _)| n).collect());
    let longest = rows.iter().map(|(name, _)| name.chars().count()).max();
    let longest = longest.unwrap_or(0) as u32;
    let labels = longest * CHARACTER + 10;
    let group = BAR * (series.len() as u32 + 1);
    let height = group * (rows.len() as u32).max(1) + FRAME;
    let greatest = rows
        .iter()
        .flat_map(|(_, bars)| bars)
        .filter_map(|&(_, length)| length)
        .fold(0.0, f64::max);
    // An axis needs a length.
    let end = if greatest > 0.0 { greatest * 1.05 } else { 1.0 };

    let mut svg = String::new();
    {
        let root = SVGBackend::with_string(&mut svg, (WIDTH + labels, height)).into_drawing_area();
        root.fill(&WHITE)?;
        let bottom = (rows.len() as f64).max(1.0);
        let mut chart = ChartBuilder::on(&root)
            .caption(title, ("sans-serif", 16))
            .margin(10)
            .x_label_area_size(36)
            .y_label_area_size(labels)
            // Downward: the first row is at the top.
            .build_cartesian_2d(0.0..end, bottom..0.0)?;
        chart
            .configure_mesh()
            .disable_y_mesh()
            .disable_y_axis()
            .y_labels(0)
            .max_light_lines(0)
            .x_desc(R::BARS_UNIT)
            .draw()?;
        let share = f64::from(BAR) / f64::from(group);
        for (number, (name, color)) in series.iter().zip(COLORS.iter().cycle()).enumerate() {
            let bars = rows.iter().enumerate().filter_map(|(row, (_, bars))| {
                let length = bars.get(number)?.1?;
                let top = row as f64 + share * (number as f64 + 0.5);
                Some(Rectangle::new(
                    [(0.0, top), (length, top + share)],
                    color.filled(),
                ))
            });
            chart.draw_series(bars)?.label(*name).legend(move |(x, y)| {
                Rectangle::new([(x, y - 5), (x + 10, y + 5)], color.filled())
            });
        }
        let beside_the_axis = ("sans-serif", 12)
            .into_font()
            .color(&BLACK)
            .pos(Pos::new(HPos::Right, VPos::Center));
        for (row, (name, _)) in rows.iter().enumerate() {
            let (x, y) = chart.backend_coord(&(0.0, row as f64 + 0.5));
            root.draw(&Text::new(
                name.as_str(),
                (x - 8, y),
                beside_the_axis.clone(),
            ))?;
        }
        chart
            .configure_series_labels()
            .position(SeriesLabelPosition::LowerRight)
            .background_style(WHITE.mix(0.8))
            .border_style(BLACK)
            .draw()?;
        root.present()?;
    }
    Ok(svg)
}

#[cfg(test)]
mod tests {
    use super::super::report::tests::report;
    use super::*;

    #[test]
    fn every_row_that_was_measured_has_a_bar_and_every_row_a_label() {
        let report = report(&[
            ("first & least", Some(30.0)),
            ("second", None),
            ("third", Some(9.0)),
        ]);
        let svg = draw(&report.rows, "plain").unwrap();
        assert!(svg.starts_with("<svg") && svg.trim_end().ends_with("</svg>"));
        for label in ["first &amp; least", "second", "third", "cpu_ms", "plain"] {
            assert!(svg.contains(label), "{label} is in {svg}");
        }
        // Two bars and one mark of the legend.
        let bars = svg.matches("#1F5A96").count();
        assert_eq!(bars, 3, "{svg}");
        assert!(draw(&super::super::report::tests::report(&[]).rows, "none").is_ok());
    }
}
