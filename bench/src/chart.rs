//! Charts of lines on logarithmic axes, as SVG: panels in a grid under one legend.

use plotters::coord::Shift;
use plotters::prelude::*;
use std::ops::Range;

/// Colours that the common kinds of colour blindness keep apart (Okabe and Ito), the first for
/// what others are compared with.
const COLORS: [RGBColor; 7] = [
    RGBColor(0, 0, 0),
    RGBColor(213, 94, 0),
    RGBColor(0, 114, 178),
    RGBColor(0, 158, 115),
    RGBColor(204, 121, 167),
    RGBColor(86, 180, 233),
    RGBColor(230, 159, 0),
];
const GUIDE: RGBColor = RGBColor(150, 150, 150);
const GRID: RGBColor = RGBColor(225, 225, 225);
const FONT: &str = "sans-serif";
/// Size of one panel, pixels.
const PANEL: (u32, u32) = (380, 300);
const LEGEND_LINE: u32 = 22;
/// Width of a legend entry's line, and of a letter on average.
const LEGEND_SAMPLE: i32 = 30;
const LETTER: f64 = 6.9;

/// A named line through points with positive coordinates; it has the same colour in every panel.
#[derive(Clone, Debug)]
pub struct Line {
    /// Name in the legend.
    pub name: String,
    /// Points from left to right; those that a logarithmic axis can't show are left out.
    pub points: Vec<(f64, f64)>,
}

impl Line {
    fn shown(&self) -> impl Iterator<Item = (f64, f64)> {
        let finite = |value: f64| value > 0.0 && value.is_finite();
        self.points.iter().copied().filter(move |(x, y)| finite(*x) && finite(*y))
    }
}

/// One pair of axes.
#[derive(Clone, Debug)]
pub struct Panel {
    /// Above the axes.
    pub title: String,
    /// Under the x axis.
    pub x_label: String,
    /// Beside the y axis.
    pub y_label: String,
    /// The lines.
    pub lines: Vec<Line>,
    /// A dashed line of this slope through the first line's first point, for comparison.
    pub guide_slope: Option<f64>,
    /// Where the x axis is labelled; chosen by the range where empty.
    pub x_ticks: Vec<f64>,
}

/// A grid of panels, `columns` in a row.
///
/// # Errors
/// Where drawing fails, in words.
pub fn svg(panels: &[Panel], columns: usize) -> Result<String, String> {
    let mut names: Vec<&str> = Vec::new();
    for line in panels.iter().flat_map(|panel| &panel.lines) {
        if !names.contains(&line.name.as_str()) {
            names.push(&line.name);
        }
    }
    let columns = columns.clamp(1, panels.len().max(1));
    let rows = panels.len().div_ceil(columns);
    let width = PANEL.0 * columns as u32;
    let places = legend_places(&names, width);
    let lines = places.iter().map(|place| place.1).max().unwrap_or(0) as u32 + 1;
    let legend_height = lines * LEGEND_LINE + 8;
    let height = legend_height + PANEL.1 * rows as u32;
    let mut text = String::new();
    {
        let root = SVGBackend::with_string(&mut text, (width, height)).into_drawing_area();
        let draw = || -> Result<(), DrawingAreaErrorKind<_>> {
            root.fill(&WHITE)?;
            draw_legend(&root, &names, &places)?;
            let (_, grid) = root.split_vertically(legend_height);
            for (area, panel) in grid.split_evenly((rows, columns)).iter().zip(panels) {
                draw_panel(&root, area, panel, &names)?;
            }
            root.present()
        };
        draw().map_err(|error| format!("a chart can't be drawn: {error}"))?;
    }
    Ok(text)
}

/// Left edge and line of every legend entry.
fn legend_places(names: &[&str], width: u32) -> Vec<(i32, i32)> {
    let (mut x, mut line) = (12, 0);
    let mut places = Vec::new();
    for name in names {
        let needed = LEGEND_SAMPLE + 24 + (name.chars().count() as f64 * LETTER) as i32;
        if x + needed > width as i32 && x > 12 {
            (x, line) = (12, line + 1);
        }
        places.push((x, line));
        x += needed;
    }
    places
}

type Area<'a> = DrawingArea<SVGBackend<'a>, Shift>;
type Drawn = Result<(), DrawingAreaErrorKind<std::io::Error>>;

fn color(index: usize) -> RGBColor {
    COLORS[index % COLORS.len()]
}

/// A marker at a pixel of the whole chart, so that lines differ by more than colour.
fn draw_marker(root: &Area, index: usize, at: (i32, i32)) -> Drawn {
    let color = color(index);
    match index % 5 {
        0 => root.draw(&Circle::new(at, 3, color.filled())),
        1 => root.draw(&TriangleMarker::new(at, 5, color.filled())),
        2 => {
            root.draw(&Rectangle::new([(at.0 - 3, at.1 - 3), (at.0 + 3, at.1 + 3)], color.filled()))
        }
        3 => root.draw(&Cross::new(at, 4, color.stroke_width(2))),
        _ => root.draw(&Circle::new(at, 4, color.stroke_width(2))),
    }
}

fn draw_legend(root: &Area, names: &[&str], places: &[(i32, i32)]) -> Drawn {
    let font = (FONT, 13).into_font();
    for (index, (name, (x, line))) in names.iter().zip(places).enumerate() {
        let y = 6 + line * LEGEND_LINE as i32 + LEGEND_LINE as i32 / 2;
        let ends = [(*x, y), (x + LEGEND_SAMPLE, y)];
        root.draw(&PathElement::new(ends, color(index).stroke_width(2)))?;
        draw_marker(root, index, (x + LEGEND_SAMPLE / 2, y))?;
        root.draw(&Text::new((*name).to_string(), (x + LEGEND_SAMPLE + 6, y - 7), font.clone()))?;
    }
    Ok(())
}

fn draw_panel(root: &Area, area: &Area, panel: &Panel, names: &[&str]) -> Drawn {
    let points = || panel.lines.iter().flat_map(Line::shown);
    let Some((x_range, y_range)) = range(points().map(|p| p.0)).zip(range(points().map(|p| p.1)))
    else {
        return area.draw(&Text::new(panel.title.clone(), (60, 14), (FONT, 15).into_font()));
    };
    let x_ticks = if panel.x_ticks.is_empty() { ticks(&x_range) } else { panel.x_ticks.clone() };
    let y_ticks = ticks(&y_range);
    let mut chart = ChartBuilder::on(area)
        .caption(&panel.title, (FONT, 15))
        .margin(8)
        .set_label_area_size(LabelAreaPosition::Left, 58)
        .set_label_area_size(LabelAreaPosition::Bottom, 40)
        .build_cartesian_2d(
            x_range.clone().log_scale().with_key_points(x_ticks),
            y_range.log_scale().with_key_points(y_ticks),
        )?;
    chart
        .configure_mesh()
        .bold_line_style(GRID)
        .light_line_style(TRANSPARENT)
        .label_style((FONT, 12))
        .axis_desc_style((FONT, 13))
        .x_desc(&panel.x_label)
        .y_desc(&panel.y_label)
        .x_label_formatter(&|value| number(*value))
        .y_label_formatter(&|value| number(*value))
        .draw()?;
    if let (Some(slope), Some(first)) =
        (panel.guide_slope, panel.lines.first().and_then(|line| line.shown().next()))
    {
        let at = |x: f64| (x, first.1 * (x / first.0).powf(slope));
        let guide = [at(x_range.start), at(x_range.end)];
        chart.draw_series(DashedLineSeries::new(guide, 5, 4, GUIDE.stroke_width(1)))?;
    }
    for line in &panel.lines {
        let index = names.iter().position(|name| *name == line.name).unwrap_or(0);
        let style = color(index).stroke_width(2);
        chart.draw_series(LineSeries::new(line.shown(), style))?;
        for point in line.shown() {
            draw_marker(root, index, chart.backend_coord(&point))?;
        }
    }
    Ok(())
}

/// The values with some room on both sides; `None` where there are none.
fn range(values: impl Iterator<Item = f64>) -> Option<Range<f64>> {
    let positive = values.filter(|value| *value > 0.0 && value.is_finite());
    let (low, high) = positive
        .fold((f64::INFINITY, 0f64), |(low, high), value| (low.min(value), high.max(value)));
    (low <= high).then(|| {
        let room = (high / low).powf(0.06).max(1.1);
        low / room..high * room
    })
}

/// Round numbers within a range, so many that the axis can be read and none touch.
fn ticks(range: &Range<f64>) -> Vec<f64> {
    let factors: &[f64] = match range.end / range.start {
        wide if wide > 300.0 => &[1.0],
        narrow if narrow < 8.0 => &[1.0, 1.5, 2.0, 3.0, 4.0, 5.0, 7.0],
        _ => &[1.0, 2.0, 5.0],
    };
    let (first, last) = (range.start.log10().floor() as i32, range.end.log10().ceil() as i32);
    let powers =
        (first..=last).flat_map(|power| factors.iter().map(move |f| f * 10f64.powi(power)));
    powers.filter(|value| range.contains(value)).collect()
}

/// A number without needless zeros.
fn number(value: f64) -> String {
    let text = format!("{value:.6}");
    text.trim_end_matches('0').trim_end_matches('.').to_string()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn panel(values: &[f64]) -> Panel {
        let points = values.iter().enumerate().map(|(i, y)| (4f64.powi(i as i32 + 3), *y));
        let line = |name: &str| Line { name: name.into(), points: points.clone().collect() };
        Panel {
            title: "a title".into(),
            x_label: "shots".into(),
            y_label: "error".into(),
            lines: vec![line("first"), line("second")],
            guide_slope: Some(-0.5),
            x_ticks: vec![64.0, 256.0],
        }
    }

    #[test]
    fn a_chart_names_its_lines_and_ticks() {
        let text = svg(&[panel(&[0.2, 0.1, 0.05]), panel(&[0.3, 0.2])], 2).unwrap();
        for word in ["a title", "shots", "error", "first", "second", "64", "256", "0.1"] {
            assert!(text.lines().any(|line| line.trim() == word), "{word} is missing");
        }
        assert!(!text.contains("NaN"));
    }

    /// A higher value is drawn higher.
    #[test]
    fn heights_follow_the_values() {
        let marker_rows = |values: &[f64]| -> Vec<f64> {
            let text = svg(&[panel(values)], 1).unwrap();
            let own = text.lines().filter(|line| line.starts_with("<circle"));
            // The first circle is the legend's.
            let rows = own.skip(1).map(|line| {
                let rest = line.split("cy=\"").nth(1).expect("a centre");
                rest.split('"').next().and_then(|y| y.parse().ok()).expect("a number")
            });
            rows.collect()
        };
        let rows = marker_rows(&[0.4, 0.1, 0.2]);
        assert!(rows[0] < rows[2] && rows[2] < rows[1], "{rows:?}");
        let (whole, half) = (rows[1] - rows[0], rows[1] - rows[2]);
        assert!((half / whole - 0.5).abs() < 0.02, "not logarithmic: {rows:?}");
    }

    #[test]
    fn what_has_no_logarithm_is_left_out() {
        assert!(svg(&[panel(&[])], 1).unwrap().contains("a title"));
        let text = svg(&[panel(&[0.1, -0.1, f64::NAN, 0.05])], 1).unwrap();
        assert!(!text.contains("NaN") && !text.contains("inf"));
        assert_eq!(text.matches("<circle").count(), 3, "two points and the legend");
    }
}
