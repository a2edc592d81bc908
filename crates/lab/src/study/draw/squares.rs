//! Squares of rows and columns, coloured by a number per million.

use super::super::table::{Row, name, number};
use super::axes::short;
use super::*;
use plotters::style::FontTransform;

impl Plan<'_> {
    pub(super) fn draw_squares<DB: DrawingBackend>(&self, area: &DrawingArea<DB, Shift>) -> Drawn
    where
        DB::ErrorType: 'static,
    {
        let (line, size) = (self.format.line(), f64::from(self.format.text));
        let (columns, names) = (self.values_of(&self.chart.x), self.values_of(&self.chart.y));
        let value_column = self.chart.series.as_deref().unwrap_or("wrong_per_million");
        let width_of = |names: &[String]| {
            (names.iter().map(|name| name.chars().count()).max().unwrap_or(0) as f64 * size * 0.55) as i32
        };
        let (left, top) = (width_of(&names) + line, width_of(&columns) + line / 2);
        let step = ((self.format.width as i32 - left - line) / columns.len().max(1) as i32).clamp(6, 6 * line);
        for (i, text) in columns.iter().enumerate() {
            let font = ("sans-serif", self.format.text).into_font().transform(FontTransform::Rotate270).color(&MUTED);
            let style = font.pos(Pos::new(HPos::Left, VPos::Center));
            area.draw(&Text::new(text.clone(), (left + i as i32 * step + step / 2, top - line / 4), style))?;
        }
        for (k, text) in names.iter().enumerate() {
            let y = top + k as i32 * line;
            let style = self.font(INK).pos(Pos::new(HPos::Right, VPos::Center));
            area.draw(&Text::new(text.clone(), (left - line / 3, y + line / 2 + self.lower()), style))?;
            for (i, column) in columns.iter().enumerate() {
                let is_here = |row: &&&Row| name(row, &self.chart.x) == *column && name(row, &self.chart.y) == *text;
                let rows = self.chart.rows(self.table);
                let Some(value) = rows.iter().find(is_here).and_then(|row| number(row, value_column)) else { continue };
                let x = left + i as i32 * step;
                area.draw(&Rectangle::new([(x + 1, y + 1), (x + step - 1, y + line - 1)], heat(value).filled()))?;
                if value > 0.0 && f64::from(step) > size * 3.0 {
                    // Dark text on the light half of the scale.
                    let ink = if share_of_heat(value) < 0.55 { INK } else { PAPER };
                    let style =
                        self.font(if ink == INK { BLACK } else { WHITE }).pos(Pos::new(HPos::Center, VPos::Center));
                    area.draw(&Text::new(short(value), (x + step / 2, y + line / 2 + self.lower()), style))?;
                }
            }
        }
        let y = top + names.len() as i32 * line + line / 2;
        let mut x = line / 2;
        for (value, text) in [(0.0, "0"), (1.0, "1"), (1e2, "100"), (1e4, "10k"), (1e6, "1M")] {
            area.draw(&Rectangle::new([(x, y), (x + line, y + line - 2)], heat(value).filled()))?;
            let style = self.font(MUTED).pos(Pos::new(HPos::Left, VPos::Center));
            area.draw(&Text::new(text, (x + line + line / 4, y + line / 2 + self.lower()), style))?;
            x += line * 3;
        }
        if !self.is_narrow() {
            let style = self.font(MUTED).pos(Pos::new(HPos::Left, VPos::Center));
            area.draw(&Text::new(Chart::label(value_column), (x, y + line / 2), style))?;
        }
        Ok(())
    }
}

/// Where a number per million is from 1 (0) to a million (1), by its logarithm.
fn share_of_heat(per_million: f64) -> f64 {
    (per_million.max(1.0).log10() / 6.0).clamp(0.0, 1.0)
}

/// Green for none; from pale yellow to dark red for 1 to a million.
fn heat(per_million: f64) -> RGBColor {
    if per_million <= 0.0 {
        return RGBColor(0xc5, 0xe3, 0xd4);
    }
    let share = share_of_heat(per_million);
    let between = |a: u8, b: u8| (f64::from(a) + (f64::from(b) - f64::from(a)) * share).round() as u8;
    RGBColor(between(0xfd, 0x7f), between(0xe3, 0x1d), between(0x9c, 0x1d))
}
