//! Bars: a row of them for each name, one for each series.

use super::super::chart::is_wrong;
use super::super::table::{Row, name, number};
use super::axes::{Axis, short};
use super::*;

impl Plan<'_> {
    pub(super) fn draw_bars<DB: DrawingBackend>(&self, area: &DrawingArea<DB, Shift>) -> Drawn
    where
        DB::ErrorType: 'static,
    {
        let (line, size) = (self.format.line(), f64::from(self.format.text));
        let (names, groups) = (self.values_of(&self.chart.x), self.series_names());
        let rows = self.chart.rows(self.table);
        let longest = names.iter().map(|name| name.chars().count()).max().unwrap_or(0) as f64;
        // On a narrow chart names stand above their bars.
        let left = if self.is_narrow() { line / 2 } else { (longest * size * 0.56) as i32 + line };
        let right = self.format.width as i32 - line * 4;
        let ends = rows.iter().filter_map(|row| {
            let end = self.chart.spread.as_ref().and_then(|[_, high]| number(row, high));
            [end, number(row, &self.chart.y)].into_iter().flatten().filter(|v| v.is_finite()).reduce(f64::max)
        });
        let axis = match self.chart.log[1] {
            false => Axis::around(ends.chain([0.0]), false, true),
            true => Axis::around(ends, true, true),
        };
        let place = |value: f64| {
            left + ((axis.place(value) - axis.low) / (axis.high - axis.low) * f64::from(right - left)) as i32
        };
        let (_, height) = area.dim_in_pixel();
        let bottom = height as i32 - line * 3;
        for tick in &axis.ticks {
            let x = place(axis.value(*tick));
            area.draw(&PathElement::new(vec![(x, 0), (x, bottom)], GRID))?;
            let style = self.font(MUTED).pos(Pos::new(HPos::Center, VPos::Top));
            area.draw(&Text::new(short(axis.value(*tick)), (x, bottom + line / 4), style))?;
        }
        let style = self.font(MUTED).pos(Pos::new(HPos::Center, VPos::Top));
        let middle = if self.is_narrow() { self.format.width as i32 / 2 } else { (left + right) / 2 };
        area.draw(&Text::new(Chart::label(&self.chart.y), (middle, bottom + line * 3 / 2), style))?;
        let bar = line * 2 / 3;
        let mut y = line / 4;
        for row_name in names {
            if self.is_narrow() {
                area.draw(&Text::new(row_name.clone(), (left, y), self.font(INK)))?;
                y += line;
            } else {
                let middle = y + groups.len().max(1) as i32 * bar / 2 + self.lower();
                let style = self.font(INK).pos(Pos::new(HPos::Right, VPos::Center));
                area.draw(&Text::new(row_name.clone(), (left - line / 3, middle), style))?;
            }
            for index in 0..groups.len().max(1) {
                let is_here = |row: &&&Row| {
                    name(row, &self.chart.x) == row_name
                        && groups.get(index).is_none_or(|group| {
                            self.chart.series.as_ref().is_none_or(|series| name(row, series) == *group)
                        })
                };
                if let Some(row) = rows.iter().find(is_here)
                    && let Some(value) =
                        number(row, &self.chart.y).filter(|v| v.is_finite() && (!axis.is_log || *v > 0.0))
                {
                    let (start, end) = (left, place(value));
                    let corners = [(start, y), (end, y + bar - 2)];
                    let is_hollow = is_wrong(row) == Some(true);
                    let style = if is_hollow { colour(index).stroke_width(2) } else { colour(index).filled() };
                    area.draw(&Rectangle::new(corners, style))?;
                    let (base_x, base_y) = area.get_base_pixel();
                    let group = groups.get(index).map_or(String::new(), |group| format!(", {group}"));
                    let tip = format!("{row_name}{group}\n{}: {}", Chart::label(&self.chart.y), short(value));
                    let around = [start + base_x, y + base_y, (end - start).max(1), bar];
                    self.tips.borrow_mut().push(Tip { place: around, text: tip });
                    let mut label_at = end;
                    if let Some([low, high]) = &self.chart.spread
                        && let (Some(low), Some(high)) = (number(row, low), number(row, high))
                    {
                        let ends = [place(low), place(high)].map(|x| (x, y + bar / 2));
                        area.draw(&PathElement::new(ends.to_vec(), INK.stroke_width(1)))?;
                        label_at = label_at.max(ends[1].0);
                    }
                    let text = match number(row, "wrong_per_million").filter(|_| is_hollow) {
                        Some(wrong) => format!("{} ({} wrong per million)", short(value), short(wrong)),
                        None => short(value),
                    };
                    let width = (text.chars().count() as f64 * size * 0.5) as i32;
                    let room = self.format.width as i32 - label_at - line / 3;
                    let text = if width > room { short(value) } else { text };
                    let style = self.font(MUTED).pos(Pos::new(HPos::Left, VPos::Center));
                    area.draw(&Text::new(text, (label_at + line / 4, y + bar / 2 + self.lower()), style))?;
                }
                y += bar;
            }
            y += line / 2;
        }
        Ok(())
    }
}
