//! Draws charts, as SVG and as pixels, by the plotters crate.
//!
//! Colours are Okabe and Ito's ("Color Universal Design", 2008), which colour-blind readers tell apart; series differ
//! in the shape of their points, too. A filled point has no wrong answer, a hollow one has some; a ring around it says
//! that the method is exact by construction. Whoever points at a mark reads its numbers.

mod axes;
mod bars;
mod labels;
mod squares;

use super::chart::{Chart, ChartKind, Point, Series, front, series};
use super::table::{Table, values};
use axes::{Axis, short};
use labels::Labels;
use plotters::coord::Shift;
use plotters::coord::ranged1d::{KeyPointHint, NoDefaultFormatting, ValueFormatter};
use plotters::prelude::*;
use plotters::style::text_anchor::{HPos, Pos, VPos};
use plotters::style::{FontStyle, register_font};
use std::cell::RefCell;
use std::error::Error;
use std::sync::Once;

type Drawn<T = ()> = std::result::Result<T, Box<dyn Error + Send + Sync>>;

/// Colours of what is not data. The report replaces them by those of the reader's light or dark page.
pub const INK: RGBColor = RGBColor(0x1b, 0x1b, 0x1f);
/// Of less important text.
pub const MUTED: RGBColor = RGBColor(0x5c, 0x5c, 0x66);
/// Of lines behind the data.
pub const GRID: RGBColor = RGBColor(0xd8, 0xd8, 0xde);
/// Behind everything.
pub const PAPER: RGBColor = RGBColor(0xff, 0xff, 0xff);

/// Okabe and Ito's colours, with grey for black and without yellow, which vanish on a dark and a light page.
const COLOURS: [RGBColor; 7] = [
    RGBColor(0x00, 0x72, 0xb2),
    RGBColor(0xd5, 0x5e, 0x00),
    RGBColor(0x00, 0x9e, 0x73),
    RGBColor(0xcc, 0x79, 0xa7),
    RGBColor(0xe6, 0x9f, 0x00),
    RGBColor(0x56, 0xb4, 0xe9),
    RGBColor(0x80, 0x80, 0x80),
];

/// Width of a chart in pixels and the height of its text.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Format {
    /// Pixels.
    pub width: u32,
    /// Pixels.
    pub text: u32,
}

impl Format {
    /// For a page on a desk, and for papers.
    pub const WIDE: Format = Format { width: 860, text: 15 };
    /// For a phone.
    pub const NARROW: Format = Format { width: 360, text: 12 };

    fn line(self) -> i32 {
        (self.text * 3 / 2) as i32
    }

    /// How many fit beside each other.
    fn characters(self) -> usize {
        (f64::from(self.width) / (f64::from(self.text) * 0.62)) as usize
    }
}

/// A chart as SVG.
#[derive(Debug, Clone, PartialEq)]
pub struct Drawing {
    /// It.
    pub svg: String,
    /// What the numbers beside points stand for whose labels had no place, from 1 on.
    pub numbered: Vec<String>,
}

/// The chart as SVG, for a page that tells what its numbers stand for.
///
/// # Errors
/// What the plotting crate reports.
pub fn svg(chart: &Chart, table: &Table, format: Format) -> Drawn<Drawing> {
    Plan::new(chart, table, format).svg()
}

/// The chart as SVG, with what its numbers stand for below it.
///
/// # Errors
/// What the plotting crate reports.
pub fn standalone_svg(chart: &Chart, table: &Table, format: Format) -> Drawn<String> {
    Ok(Plan::standalone(chart, table, format)?.svg()?.svg)
}

/// What is read of a mark by whoever points at it.
struct Tip {
    /// Left, top, width and height in the picture.
    place: [i32; 4],
    text: String,
}

impl Tip {
    fn markup(&self) -> String {
        let [x, y, width, height] = self.place;
        let text = self.text.replace('&', "&amp;").replace('<', "&lt;");
        format!(
            "<rect x=\"{x}\" y=\"{y}\" width=\"{width}\" height=\"{height}\" \
             fill-opacity=\"0\"><title>{text}</title></rect>\n"
        )
    }
}

/// The same as pixels: width, height, and three bytes each, the top row first; at twice the size, so that text is
/// sharp.
///
/// # Errors
/// What the plotting crate reports.
pub fn pixels(chart: &Chart, table: &Table, format: Format) -> Drawn<(u32, u32, Vec<u8>)> {
    let format = Format { width: format.width * 2, text: format.text * 2 };
    let plan = Plan::standalone(chart, table, format)?;
    let (width, height) = (format.width, plan.height());
    let mut bytes = vec![0; width as usize * height as usize * 3];
    {
        let area = BitMapBackend::with_buffer(&mut bytes, (width, height)).into_drawing_area();
        plan.draw(&area)?;
        area.present()?;
    }
    Ok((width, height, bytes))
}

fn prepare_font() {
    static ONCE: Once = Once::new();
    ONCE.call_once(|| {
        // The font is in the program: a machine that measures need not have any.
        let _ = register_font("sans-serif", FontStyle::Normal, epaint_default_fonts::UBUNTU_LIGHT);
    });
}

fn colour(index: usize) -> RGBColor {
    COLOURS[index % COLOURS.len()]
}

/// What is drawn, and how much room it takes.
struct Plan<'a> {
    chart: &'a Chart,
    table: &'a Table,
    format: Format,
    series: Vec<Series>,
    /// Lines of the title.
    title: Vec<String>,
    /// Lines below the chart.
    below: Vec<String>,
    /// Found while it is drawn.
    tips: RefCell<Vec<Tip>>,
    numbered: RefCell<Vec<String>>,
}

impl<'a> Plan<'a> {
    fn new(chart: &'a Chart, table: &'a Table, format: Format) -> Plan<'a> {
        prepare_font();
        let title = wrapped(&chart.title, format.characters());
        let (series, below) = (series(chart, table), Vec::new());
        Plan { chart, table, format, series, title, below, tips: RefCell::default(), numbered: RefCell::default() }
    }

    /// With a list of what the numbers beside points stand for.
    fn standalone(chart: &'a Chart, table: &'a Table, format: Format) -> Drawn<Plan<'a>> {
        let plan = Plan::new(chart, table, format);
        // They are known once it is drawn.
        let numbered = plan.svg()?.numbered;
        let list: Vec<_> = numbered.iter().enumerate().map(|(i, name)| format!("{}: {name}", i + 1)).collect();
        Ok(Plan { below: wrapped(&list.join("; "), format.characters()), ..plan })
    }

    fn svg(&self) -> Drawn<Drawing> {
        self.tips.borrow_mut().clear();
        let mut text = String::new();
        {
            let area = SVGBackend::with_string(&mut text, (self.format.width, self.height())).into_drawing_area();
            self.draw(&area)?;
            area.present()?;
        }
        // On top of all marks: what is transparent is still pointed at.
        let tips: String = self.tips.borrow().iter().map(Tip::markup).collect();
        if let Some(end) = text.rfind("</svg>") {
            text.insert_str(end, &tips);
        }
        Ok(Drawing { svg: text, numbered: self.numbered.borrow().clone() })
    }

    fn top(&self) -> i32 {
        self.title.len() as i32 * self.format.line() + self.format.line() / 3
    }

    /// The names in a column of the rows that are shown, each once, in their order.
    fn values_of(&self, column: &str) -> Vec<String> {
        values(self.chart.rows(self.table), column)
    }

    fn series_names(&self) -> Vec<String> {
        match (&self.chart.series, self.chart.kind) {
            (None, _) | (_, ChartKind::Heat) => Vec::new(),
            (Some(column), _) => self.values_of(column),
        }
    }

    /// Places of the legend's entries, and its height.
    fn legend(&self) -> (Vec<(i32, i32, String)>, i32) {
        let (mut x, mut y, mut places) = (0, 0, Vec::new());
        let names = self.series_names();
        if names.len() < 2 {
            return (places, 0);
        }
        let size = f64::from(self.format.text);
        for name in names {
            let width = (size * (2.6 + 0.58 * name.chars().count() as f64)) as i32;
            if x > 0 && x + width > self.format.width as i32 - self.format.line() {
                (x, y) = (0, y + self.format.line());
            }
            places.push((x, y, name));
            x += width;
        }
        (places, y + self.format.line())
    }

    fn height(&self) -> u32 {
        let line = self.format.line();
        let body = match self.chart.kind {
            ChartKind::Lines | ChartKind::Front => (self.format.width as i32 * 11 / 20).max(17 * line),
            ChartKind::Bars => {
                let bars = self.series_names().len().max(1) as i32;
                let names = self.values_of(&self.chart.x).len() as i32;
                let extra = if self.is_narrow() { line } else { 0 };
                names * (bars * (line * 2 / 3) + line / 2 + extra) + 4 * line
            }
            ChartKind::Heat => {
                let columns = self.values_of(&self.chart.x);
                let longest = columns.iter().map(|name| name.chars().count()).max().unwrap_or(0);
                self.values_of(&self.chart.y).len() as i32 * line
                    + (longest as f64 * f64::from(self.format.text) * 0.55) as i32
                    + 3 * line
            }
        };
        (self.top() + self.legend().1 + body + self.height_below()) as u32
    }

    fn height_below(&self) -> i32 {
        let line = self.format.line();
        self.below.len() as i32 * line + if self.below.is_empty() { 0 } else { line / 2 }
    }

    fn is_narrow(&self) -> bool {
        self.format.width / self.format.text < 40
    }

    /// How far below the middle of a font's box its small letters are in the middle.
    fn lower(&self) -> i32 {
        (self.format.text / 6) as i32
    }

    fn font(&self, colour: RGBColor) -> TextStyle<'static> {
        ("sans-serif", self.format.text).into_font().color(&colour)
    }

    fn draw<DB: DrawingBackend>(&self, area: &DrawingArea<DB, Shift>) -> Drawn
    where
        DB::ErrorType: 'static,
    {
        area.fill(&PAPER)?;
        let line = self.format.line();
        for (i, text) in self.title.iter().enumerate() {
            area.draw(&Text::new(text.clone(), (line / 3, i as i32 * line + line / 4), self.font(INK)))?;
        }
        let (places, legend_height) = self.legend();
        for (index, (x, y, text)) in places.into_iter().enumerate() {
            let at = (x + line / 2, self.top() + y + line / 2);
            self.mark(area, at, index, Some(false))?;
            let style = self.font(MUTED).pos(Pos::new(HPos::Left, VPos::Center));
            area.draw(&Text::new(text, (at.0 + line / 2, at.1 + self.lower()), style))?;
        }
        let (_, body) = area.split_vertically(self.top() + legend_height);
        let (body, below) = body.split_vertically(body.dim_in_pixel().1 as i32 - self.height_below());
        for (i, text) in self.below.iter().enumerate() {
            below.draw(&Text::new(text.clone(), (line / 3, i as i32 * line), self.font(MUTED)))?;
        }
        let has_data = match self.chart.kind {
            ChartKind::Lines | ChartKind::Front => !self.series.is_empty(),
            ChartKind::Bars | ChartKind::Heat => !self.chart.rows(self.table).is_empty(),
        };
        if !has_data {
            body.draw(&Text::new("nothing was measured that this could show", (line, 2 * line), self.font(MUTED)))?;
            return Ok(());
        }
        match self.chart.kind {
            ChartKind::Lines | ChartKind::Front => self.draw_points(&body),
            ChartKind::Bars => self.draw_bars(&body),
            ChartKind::Heat => self.draw_squares(&body),
        }
    }

    /// A point: its colour and shape tell its series; hollow where an answer was wrong.
    fn mark<DB: DrawingBackend>(
        &self,
        area: &DrawingArea<DB, Shift>,
        (x, y): (i32, i32),
        index: usize,
        is_wrong: Option<bool>,
    ) -> Drawn
    where
        DB::ErrorType: 'static,
    {
        let r = (self.format.text as i32 * 3 / 10).max(3);
        let style = match is_wrong {
            Some(true) => colour(index).stroke_width(if self.format.text > 20 { 3 } else { 2 }),
            _ => colour(index).filled(),
        };
        let corners = |offsets: &[(i32, i32)]| {
            let mut corners: Vec<_> = offsets.iter().map(|(dx, dy)| (x + dx * r / 4, y + dy * r / 4)).collect();
            corners.push(corners[0]);
            corners
        };
        let shape: &[(i32, i32)] = match index % 5 {
            0 => {
                if is_wrong == Some(true) {
                    area.draw(&Circle::new((x, y), r, PAPER.filled()))?;
                }
                area.draw(&Circle::new((x, y), r, style))?;
                return Ok(());
            }
            1 => &[(-4, -4), (4, -4), (4, 4), (-4, 4)],
            2 => &[(0, -6), (5, 4), (-5, 4)],
            3 => &[(0, -6), (5, 0), (0, 6), (-5, 0)],
            _ => &[(0, 6), (5, -4), (-5, -4)],
        };
        if is_wrong == Some(true) {
            area.draw(&Polygon::new(corners(shape), PAPER.filled()))?;
            area.draw(&PathElement::new(corners(shape), style))?;
        } else {
            area.draw(&Polygon::new(corners(shape), style))?;
        }
        Ok(())
    }

    fn draw_points<DB: DrawingBackend>(&self, area: &DrawingArea<DB, Shift>) -> Drawn
    where
        DB::ErrorType: 'static,
    {
        let line = self.format.line();
        let points = || self.series.iter().flat_map(|series| &series.points);
        // A bar that goes down to 0 ends where a logarithmic axis does.
        let can_be_shown = |value: &f64, axis: usize| !self.chart.log[axis] || *value > 0.0;
        let ends = points().flat_map(|p| p.x_spread.into_iter().flatten().chain([p.x]));
        let x_axis = Axis::around(ends.filter(|end| can_be_shown(end, 0)), self.chart.log[0], self.is_narrow());
        let ends = points().flat_map(|p| p.spread.into_iter().flatten().chain([p.y]));
        let y_axis = Axis::around(ends.filter(|end| can_be_shown(end, 1)), self.chart.log[1], self.is_narrow());
        let mut plot = ChartBuilder::on(area)
            .margin(line / 3)
            .margin_right(line)
            .x_label_area_size(line * 5 / 2)
            .y_label_area_size(line * 3)
            .build_cartesian_2d(Ticks(x_axis.clone()), Ticks(y_axis.clone()))?;
        plot.configure_mesh()
            .light_line_style(TRANSPARENT)
            .bold_line_style(GRID)
            .axis_style(MUTED)
            .label_style(self.font(MUTED))
            .axis_desc_style(self.font(MUTED))
            .x_desc(Chart::label(&self.chart.x))
            .y_desc(Chart::label(&self.chart.y))
            .x_labels(20)
            .y_labels(20)
            .draw()?;
        let on = |axis: &Axis, value: f64| axis.place(value).max(axis.low);
        let at = |x: f64, y: f64| plot.backend_coord(&(on(&x_axis, x), on(&y_axis, y)));
        let place = |p: &Point, y: f64| at(p.x, y);
        let stroke = if self.format.text > 20 { 4 } else { 2 };
        let (left, top) = area.get_base_pixel();
        let here = |(x, y): (i32, i32)| (x - left, y - top);
        for (index, series) in self.series.iter().enumerate() {
            for p in &series.points {
                let spread = p.spread.map(|ends| ends.map(|y| here(at(p.x, y))));
                let x_spread = p.x_spread.map(|ends| ends.map(|x| here(at(x, p.y))));
                for ends in spread.into_iter().chain(x_spread) {
                    area.draw(&PathElement::new(ends.to_vec(), colour(index).mix(0.6).stroke_width(stroke / 2)))?;
                }
            }
            if self.chart.kind == ChartKind::Lines {
                let path: Vec<_> = series.points.iter().map(|p| here(place(p, p.y))).collect();
                area.draw(&PathElement::new(path, colour(index).stroke_width(stroke)))?;
            }
        }
        if self.chart.kind == ChartKind::Front {
            let all: Vec<Point> = points().cloned().collect();
            // A staircase: between two points of the front nothing better is known than the left one.
            let mut path = Vec::new();
            for p in front(&all) {
                let at = here(place(p, p.y));
                if let Some(&(_, y)) = path.last() {
                    path.push((at.0, y));
                }
                path.push(at);
            }
            area.draw(&PathElement::new(path, MUTED.stroke_width(stroke / 2)))?;
        }
        for (index, series) in self.series.iter().enumerate() {
            for p in &series.points {
                let at = here(place(p, p.y));
                if p.is_exact {
                    let ring = self.format.text as i32 / 2 + stroke as i32 / 2;
                    area.draw(&Circle::new(at, ring, MUTED.stroke_width(stroke / 2)))?;
                }
                self.mark(area, at, index, p.is_wrong)?;
                self.tell_point(series, p, (at.0 + left, at.1 + top));
            }
        }
        if self.chart.kind == ChartKind::Front {
            let at: Vec<_> = points().map(|p| (here(place(p, p.y)), p.label.clone())).collect();
            let (width, height) = area.dim_in_pixel();
            let bounds = (line * 3, 0, width as i32 - line / 2, height as i32 - line * 3);
            let (labels, numbered) = Labels::new(self.format.text as i32, bounds).place(&at);
            for label in labels {
                let style = self.font(INK).pos(Pos::new(label.side, VPos::Top));
                area.draw(&Text::new(label.text, label.at, style))?;
            }
            *self.numbered.borrow_mut() = numbered;
        }
        Ok(())
    }

    /// What a point says.
    fn tell_point(&self, series: &Series, p: &Point, (x, y): (i32, i32)) {
        let reach = self.format.text as i32 / 2;
        let names = [&p.label, &series.name].into_iter().filter(|name| !name.is_empty()).cloned().collect::<Vec<_>>();
        let [of_x, of_y] = [&self.chart.x, &self.chart.y].map(|column| Chart::label(column));
        let text = format!("{}\n{of_x}: {}\n{of_y}: {}", names.join(", "), short(p.x), short(p.y));
        self.tips.borrow_mut().push(Tip { place: [x - reach, y - reach, 2 * reach, 2 * reach], text });
    }
}

/// An axis as plotters takes it: its ticks are those of the axis.
#[derive(Clone)]
struct Ticks(Axis);

impl plotters::coord::ranged1d::Ranged for Ticks {
    type FormatOption = NoDefaultFormatting;
    type ValueType = f64;

    fn map(&self, value: &f64, limit: (i32, i32)) -> i32 {
        let share = (value - self.0.low) / (self.0.high - self.0.low);
        limit.0 + (share * f64::from(limit.1 - limit.0)).round() as i32
    }

    fn key_points<Hint: KeyPointHint>(&self, _hint: Hint) -> Vec<f64> {
        self.0.ticks.clone()
    }

    fn range(&self) -> std::ops::Range<f64> {
        self.0.low..self.0.high
    }
}

impl ValueFormatter<f64> for Ticks {
    fn format_ext(&self, value: &f64) -> String {
        short(self.0.value(*value))
    }
}

/// The text in lines of at most so many characters.
fn wrapped(text: &str, width: usize) -> Vec<String> {
    let mut lines: Vec<String> = Vec::new();
    for word in text.split_whitespace() {
        match lines.last_mut() {
            Some(line) if line.chars().count() + 1 + word.chars().count() <= width => {
                line.push(' ');
                line.push_str(word);
            }
            _ => lines.push(word.to_owned()),
        }
    }
    lines
}
