//! Charts of lines on logarithmic axes, as SVG and PNG: panels in a grid under one legend.

use crate::raster::{self, Raster};
use image::RgbImage;
use plotters::coord::Shift;
use plotters::coord::combinators::WithKeyPoints;
use plotters::prelude::*;
use plotters::style::text_anchor::{HPos, Pos, VPos};
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
const WORDS: RGBColor = RGBColor(90, 90, 90);
const FONT: &str = "sans-serif";
/// Size of one panel where nothing else is said, pixels.
pub const PANEL: (u32, u32) = (380, 300);
const LEGEND_LINE: u32 = 22;
/// Width of a legend entry's line, and of a letter on average.
const LEGEND_SAMPLE: i32 = 30;
const LETTER: f64 = 6.9;
/// How much of a band lets the ground through.
const BAND: f64 = 0.16;
/// A line of more points has a marker only at its end.
const MOST_MARKERS: usize = 40;
/// Most labels of an axis that covers many decades.
const MOST_DECADES: i32 = 9;

/// A named line through points with positive coordinates; it has the same colour in every panel.
#[derive(Clone, Debug, Default)]
pub struct Line {
    /// Name in the legend.
    pub name: String,
    /// Points from left to right; those that a logarithmic axis can't show are left out.
    pub points: Vec<(f64, f64)>,
    /// Shaded spread around the line: x, lowest and highest y from left to right; what a
    /// logarithmic axis can't show is left out.
    pub band: Vec<(f64, f64, f64)>,
}

fn shows(value: f64) -> bool {
    value > 0.0 && value.is_finite()
}

impl Line {
    fn shown(&self) -> impl Iterator<Item = (f64, f64)> {
        self.points.iter().copied().filter(|(x, y)| shows(*x) && shows(*y))
    }

    fn band(&self) -> impl DoubleEndedIterator<Item = (f64, f64, f64)> {
        let all = self.band.iter().copied();
        all.filter(|(x, low, high)| shows(*x) && shows(*low) && shows(*high))
    }
}

/// A horizontal line with its name written above it.
#[derive(Clone, Debug, Default)]
pub struct Level {
    /// Its name.
    pub name: String,
    /// Where it is.
    pub value: f64,
}

/// One pair of axes.
#[derive(Clone, Debug, Default)]
pub struct Panel {
    /// Above the axes.
    pub title: String,
    /// Under the x axis.
    pub x_label: String,
    /// Beside the y axis.
    pub y_label: String,
    /// The lines.
    pub lines: Vec<Line>,
    /// Horizontal lines.
    pub levels: Vec<Level>,
    /// Dashed lines of these slopes through the first line's first point, for comparison.
    pub guide_slopes: Vec<f64>,
    /// Where the x axis is labelled; chosen by the range where empty.
    pub x_ticks: Vec<f64>,
    /// Whether the y axis is labelled in percent.
    pub y_percent: bool,
    /// What stands there where no line has a point.
    pub empty: String,
}

/// A grid of panels.
#[derive(Clone, Debug)]
pub struct Chart {
    /// The panels, row by row.
    pub panels: Vec<Panel>,
    /// Panels in a row.
    pub columns: usize,
    /// Width and height of a panel, pixels.
    pub panel_size: (u32, u32),
    /// Whether the lines are named above the panels.
    pub legend: bool,
}

/// Where everything of a chart is.
struct Layout<'a> {
    names: Vec<&'a str>,
    /// Left edge and line of every legend entry.
    places: Vec<(i32, i32)>,
    legend_height: u32,
    rows: usize,
    columns: usize,
    size: (u32, u32),
}

impl Chart {
    /// Panels of the usual size, `columns` in a row, with a legend.
    pub fn new(panels: Vec<Panel>, columns: usize) -> Self {
        Self { panels, columns, panel_size: PANEL, legend: true }
    }

    /// As an SVG document; needs no fonts, names a generic family.
    ///
    /// # Errors
    /// Where drawing fails, in words.
    pub fn svg(&self) -> Result<String, String> {
        let layout = self.layout();
        let mut text = String::new();
        {
            let root = SVGBackend::with_string(&mut text, layout.size).into_drawing_area();
            self.draw(&root, &layout).map_err(failed)?;
        }
        Ok(titled(text, &self.title()))
    }

    /// What the chart shows, for those who don't see it.
    fn title(&self) -> String {
        let titles: Vec<&str> = self.panels.iter().map(|panel| panel.title.as_str()).collect();
        titles.join("; ")
    }

    /// As a PNG file, `scale` × `scale` pixels for one of the SVG.
    ///
    /// # Errors
    /// Where drawing fails, in words.
    pub fn png(&self, scale: u32) -> Result<Vec<u8>, String> {
        let layout = self.layout();
        let (width, height) = layout.size;
        let mut image = RgbImage::new(width * scale, height * scale);
        {
            let root = Raster::new(&mut image, scale).into_drawing_area();
            self.draw(&root, &layout).map_err(failed)?;
        }
        raster::png(&image).map_err(failed)
    }

    fn layout(&self) -> Layout<'_> {
        let mut names: Vec<&str> = Vec::new();
        for line in self.panels.iter().flat_map(|panel| &panel.lines) {
            if !names.contains(&line.name.as_str()) {
                names.push(&line.name);
            }
        }
        let columns = self.columns.clamp(1, self.panels.len().max(1));
        let rows = self.panels.len().div_ceil(columns).max(1);
        let width = self.panel_size.0 * columns as u32;
        let places = legend_places(&names, width);
        let lines = places.iter().map(|place| place.1).max().unwrap_or(0) as u32 + 1;
        let legend_height = if self.legend { lines * LEGEND_LINE + 8 } else { 0 };
        let size = (width, legend_height + self.panel_size.1 * rows as u32);
        Layout { names, places, legend_height, rows, columns, size }
    }

    fn draw<D: DrawingBackend>(&self, root: &Area<D>, layout: &Layout<'_>) -> Drawn<D> {
        root.fill(&WHITE)?;
        if self.legend {
            draw_legend(root, &layout.names, &layout.places)?;
        }
        let (_, grid) = root.split_vertically(layout.legend_height);
        let areas = grid.split_evenly((layout.rows, layout.columns));
        for (area, panel) in areas.iter().zip(&self.panels) {
            draw_panel(root, area, panel, &layout.names)?;
        }
        root.present()
    }
}

/// The document with a title element.
fn titled(svg: String, title: &str) -> String {
    let safe = title.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;");
    svg.replacen(">\n", &format!(" role=\"img\">\n<title>{safe}</title>\n"), 1)
}

fn failed(error: impl std::fmt::Display) -> String {
    format!("a chart can't be drawn: {error}")
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

type Area<D> = DrawingArea<D, Shift>;
type Drawn<D> = Result<(), DrawingAreaErrorKind<<D as DrawingBackend>::ErrorType>>;

fn color(index: usize) -> RGBColor {
    COLORS[index % COLORS.len()]
}

/// A marker at a pixel of the whole chart, so that lines differ by more than colour.
fn draw_marker<D: DrawingBackend>(root: &Area<D>, index: usize, at: (i32, i32)) -> Drawn<D> {
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

fn draw_legend<D: DrawingBackend>(
    root: &Area<D>,
    names: &[&str],
    places: &[(i32, i32)],
) -> Drawn<D> {
    let font = (FONT, 13).into_font();
    for (index, (name, (x, line))) in names.iter().zip(places).enumerate() {
        let y = 6 + line * LEGEND_LINE as i32 + LEGEND_LINE as i32 / 2;
        let ends = [(*x, y), (x + LEGEND_SAMPLE, y)];
        root.draw(&PathElement::new(ends, color(index).stroke_width(2)))?;
        draw_marker(root, index, (x + LEGEND_SAMPLE / 2, y))?;
        let anchor = Pos::new(HPos::Left, VPos::Center);
        let style = TextStyle::from(font.clone()).pos(anchor);
        root.draw(&Text::new((*name).to_string(), (x + LEGEND_SAMPLE + 6, y), style))?;
    }
    Ok(())
}

fn draw_panel<D: DrawingBackend>(
    root: &Area<D>,
    area: &Area<D>,
    panel: &Panel,
    names: &[&str],
) -> Drawn<D> {
    let points = || panel.lines.iter().flat_map(Line::shown);
    let bands = || panel.lines.iter().flat_map(Line::band);
    let levels = panel.levels.iter().map(|level| level.value);
    let xs = range(points().map(|p| p.0));
    let ys = range(
        points().map(|p| p.1).chain(bands().flat_map(|(_, low, high)| [low, high])).chain(levels),
    );
    let Some((x_range, y_range)) = xs.zip(ys) else {
        return draw_empty(area, panel);
    };
    let x_ticks = if panel.x_ticks.is_empty() { ticks(&x_range) } else { panel.x_ticks.clone() };
    let y_ticks = ticks(&y_range);
    let mut chart = ChartBuilder::on(area)
        .caption(&panel.title, (FONT, 15))
        .margin(8)
        .margin_right(14)
        .set_label_area_size(LabelAreaPosition::Left, 62)
        .set_label_area_size(LabelAreaPosition::Bottom, 40)
        .build_cartesian_2d(
            x_range.clone().log_scale().with_key_points(x_ticks),
            y_range.clone().log_scale().with_key_points(y_ticks),
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
        .y_label_formatter(&|value| match panel.y_percent {
            true => format!("{} %", number(100.0 * value)),
            false => number(*value),
        })
        .draw()?;
    let ranges = (x_range, y_range);
    draw_guides(&mut chart, panel, &ranges)?;
    draw_levels(root, &mut chart, panel, &ranges)?;
    draw_bands(&mut chart, panel, names)?;
    draw_lines(root, &mut chart, panel, names)
}

/// A logarithmic axis with the ticks that are to be.
type Axis = WithKeyPoints<LogCoord<f64>>;

/// What a panel's lines are drawn on.
type Plot<'a, D> = ChartContext<'a, D, Cartesian2d<Axis, Axis>>;

/// The slopes that lines are compared with, through the first point of the first line.
fn draw_guides<D: DrawingBackend>(
    plot: &mut Plot<'_, D>,
    panel: &Panel,
    (x_range, y_range): &(Range<f64>, Range<f64>),
) -> Drawn<D> {
    let Some(first) = panel.lines.iter().find_map(|line| line.shown().next()) else {
        return Ok(());
    };
    for slope in &panel.guide_slopes {
        let at = |x: f64| (x, first.1 * (x / first.0).powf(*slope));
        let guide = within([at(x_range.start), at(x_range.end)], y_range, *slope);
        plot.draw_series(DashedLineSeries::new(guide, 5, 4, GUIDE.stroke_width(1)))?;
    }
    Ok(())
}

/// Dotted lines at named values.
fn draw_levels<D: DrawingBackend>(
    root: &Area<D>,
    plot: &mut Plot<'_, D>,
    panel: &Panel,
    (x_range, y_range): &(Range<f64>, Range<f64>),
) -> Drawn<D> {
    for level in panel.levels.iter().filter(|level| shows(level.value)) {
        let ends = [(x_range.start, level.value), (x_range.end, level.value)];
        plot.draw_series(DashedLineSeries::new(ends, 2, 3, WORDS.stroke_width(1)))?;
        let (x, y) = plot.backend_coord(&ends[0]);
        // On the left, where falling errors are still high; above the line, but below it where it
        // runs along the top.
        let (_, top) = plot.backend_coord(&(x_range.end, y_range.end));
        let (at, side) = match y - top < 18 {
            true => (y + 3, VPos::Top),
            false => (y - 2, VPos::Bottom),
        };
        let style = TextStyle::from((FONT, 12).into_font());
        let style = style.color(&WORDS).pos(Pos::new(HPos::Left, side));
        root.draw(&Text::new(level.name.clone(), (x + 6, at), style))?;
    }
    Ok(())
}

/// Which colour a line has: that of its name.
fn index_of(line: &Line, names: &[&str]) -> usize {
    names.iter().position(|name| *name == line.name).unwrap_or(0)
}

/// The spreads of lines, below all of them.
fn draw_bands<D: DrawingBackend>(
    plot: &mut Plot<'_, D>,
    panel: &Panel,
    names: &[&str],
) -> Drawn<D> {
    for line in &panel.lines {
        let upper = line.band().map(|(x, _, high)| (x, high));
        let lower = line.band().rev().map(|(x, low, _)| (x, low));
        let outline: Vec<(f64, f64)> = upper.chain(lower).collect();
        if outline.len() > 2 {
            let shade = color(index_of(line, names)).mix(BAND).filled();
            plot.draw_series(std::iter::once(Polygon::new(outline, shade)))?;
        }
    }
    Ok(())
}

/// Lines with their markers.
fn draw_lines<D: DrawingBackend>(
    root: &Area<D>,
    plot: &mut Plot<'_, D>,
    panel: &Panel,
    names: &[&str],
) -> Drawn<D> {
    for line in &panel.lines {
        let index = index_of(line, names);
        let points: Vec<(f64, f64)> = line.shown().collect();
        let style = color(index).stroke_width(2);
        plot.draw_series(LineSeries::new(points.iter().copied(), style))?;
        let marked = if points.len() > MOST_MARKERS { points.len() - 1 } else { 0 };
        for point in &points[marked..] {
            draw_marker(root, index, plot.backend_coord(point))?;
        }
    }
    Ok(())
}

/// A frame without axes, with the reason in its middle.
fn draw_empty<D: DrawingBackend>(area: &Area<D>, panel: &Panel) -> Drawn<D> {
    let (width, height) = area.dim_in_pixel();
    let (width, height) = (width as i32, height as i32);
    let text = |size: i32, color: &'static RGBColor| {
        let centered = Pos::new(HPos::Center, VPos::Center);
        TextStyle::from((FONT, size).into_font()).color(color).pos(centered)
    };
    let frame = [(62, 30), (width - 14, height - 48)];
    area.draw(&Rectangle::new(frame, GRID.stroke_width(1)))?;
    area.draw(&Text::new(panel.title.clone(), (width / 2, 16), text(15, &BLACK)))?;
    area.draw(&Text::new(panel.empty.clone(), (width / 2, height / 2), text(14, &WORDS)))
}

/// A line of a slope between two points, cut to a range of y.
fn within(ends: [(f64, f64); 2], y: &Range<f64>, slope: f64) -> [(f64, f64); 2] {
    let [start, _] = ends;
    ends.map(|(x, height)| {
        let kept = height.clamp(y.start, y.end);
        if kept == height {
            (x, height)
        } else {
            (start.0 * (kept / start.1).powf(1.0 / slope), kept)
        }
    })
}

/// The values with some room on both sides; `None` where there are none.
fn range(values: impl Iterator<Item = f64>) -> Option<Range<f64>> {
    let (low, high) = values
        .filter(|value| shows(*value))
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
    let step = ((last - first) / MOST_DECADES + 1) as usize;
    let powers = (first..=last)
        .step_by(step)
        .flat_map(|power| factors.iter().map(move |f| f * 10f64.powi(power)));
    let found: Vec<f64> = powers.filter(|value| range.contains(value)).collect();
    if found.len() > 1 {
        return found;
    }
    // A narrow range between round numbers: values near its ends, with as few digits as will do.
    let rounded = |value: f64, digits: i32| {
        let unit = 10f64.powi(value.log10().floor() as i32 - digits);
        (value / unit).round() * unit
    };
    let inner = (range.end / range.start).powf(0.1);
    let ends = [range.start * inner, range.end / inner];
    let candidates = (1..=6).map(|digits| ends.map(|end| rounded(end, digits)).to_vec());
    let fits = |found: &Vec<f64>| found.iter().all(|value| range.contains(value));
    candidates.into_iter().find(fits).unwrap_or(found)
}

/// A number without needless zeros.
fn number(value: f64) -> String {
    if !(1e-4..1e6).contains(&value.abs()) && value != 0.0 {
        return format!("{value:.1e}").replace(".0e", "e");
    }
    let text = format!("{value:.6}");
    text.trim_end_matches('0').trim_end_matches('.').to_string()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn panel(values: &[f64]) -> Panel {
        let points = values.iter().enumerate().map(|(i, y)| (4f64.powi(i as i32 + 3), *y));
        let line = |name: &str| Line {
            name: name.into(),
            points: points.clone().collect(),
            ..Line::default()
        };
        Panel {
            title: "a title".into(),
            x_label: "shots".into(),
            y_label: "error".into(),
            lines: vec![line("first"), line("second")],
            guide_slopes: vec![-0.5],
            x_ticks: vec![64.0, 256.0],
            empty: "nothing yet".into(),
            ..Panel::default()
        }
    }

    fn svg(panel: Panel) -> String {
        Chart::new(vec![panel], 1).svg().unwrap()
    }

    #[test]
    fn a_chart_names_its_lines_and_ticks() {
        let panels = vec![panel(&[0.2, 0.1, 0.05]), panel(&[0.3, 0.2])];
        let text = Chart::new(panels, 2).svg().unwrap();
        for word in ["a title", "shots", "error", "first", "second", "64", "256", "0.1"] {
            assert!(text.lines().any(|line| line.trim() == word), "{word} is missing");
        }
        assert!(!text.contains("NaN"));
        assert!(text.contains("<title>a title; a title</title>"));
        let hostile = svg(Panel { title: "</title><script>&".into(), ..panel(&[0.2]) });
        assert!(!hostile.contains("<script>"));
    }

    /// A higher value is drawn higher.
    #[test]
    fn heights_follow_the_values() {
        let marker_rows = |values: &[f64]| -> Vec<f64> {
            let text = svg(panel(values));
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
        let empty = svg(panel(&[]));
        assert!(empty.contains("a title") && empty.contains("nothing yet"));
        let mut holes = panel(&[0.1, -0.1, f64::NAN, 0.05]);
        holes.lines[0].band = vec![(64.0, -0.1, 0.2), (64.0, 0.05, 0.2), (256.0, 0.04, f64::NAN)];
        let text = svg(holes);
        assert!(!text.contains("NaN") && !text.contains("inf"));
        assert_eq!(text.matches("<circle").count(), 3, "two points and the legend");
    }

    #[test]
    fn bands_and_levels_are_in_view() {
        let mut bare = panel(&[0.1, 0.1]);
        bare.guide_slopes.clear();
        let without = svg(bare.clone());
        assert!(!without.contains("target"));
        bare.lines[1].band = vec![(64.0, 0.05, 0.2), (256.0, 0.02, 0.4)];
        bare.levels = vec![Level { name: "target".into(), value: 0.001 }];
        bare.y_percent = true;
        let with = svg(bare);
        assert_eq!(with.matches("<polygon").count(), without.matches("<polygon").count() + 1);
        assert!(with.lines().any(|line| line == "target"));
        assert!(with.lines().any(|line| line == "0.1 %"), "the axis reaches down to the level");
    }

    #[test]
    fn ticks_are_few_and_never_none() {
        for (low, high) in [(1e-16, 1.0), (0.9, 1.1), (11.2, 11.9), (1.0, 50.0), (250.0, 16000.0)] {
            let range = low..high;
            let ticks = ticks(&range);
            assert!((1..=12).contains(&ticks.len()), "{range:?}: {ticks:?}");
            assert!(ticks.iter().all(|tick| range.contains(tick)), "{range:?}: {ticks:?}");
        }
        assert_eq!([1e-12, 0.05, 16000.0, 2e6].map(number), ["1e-12", "0.05", "16000", "2e6"]);
    }

    /// The same drawing as pixels: white ground, every line's colour, at the size of the SVG.
    #[test]
    fn the_png_shows_what_the_svg_shows() {
        let chart = Chart::new(vec![panel(&[0.4, 0.1, 0.2])], 1);
        let image = image::load_from_memory(&chart.png(2).unwrap()).unwrap().into_rgb8();
        let text = chart.svg().unwrap();
        assert!(text.contains(&format!("width=\"{}\"", image.width() / 2)));
        let count = |wanted: [u8; 3]| image.pixels().filter(|p| p.0 == wanted).count();
        assert!(count([255; 3]) > image.pixels().len() * 3 / 4);
        let RGBColor(r, g, b) = COLORS[1];
        assert!(count([r, g, b]) > 200 && count([0; 3]) > 200);
    }
}
