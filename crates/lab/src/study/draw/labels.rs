//! Puts labels beside points so that they cover neither each other nor points. A label without a free place becomes a
//! number, which is explained below the chart; without a place for that, too, it is told there alone.

use plotters::style::text_anchor::HPos;

type Box2 = (i32, i32, i32, i32);

/// Places for labels.
pub struct Labels {
    text: i32,
    bounds: Box2,
}

/// A label that has a place.
pub struct Label {
    /// The upper end of its text, in the middle or at one end as `side` says.
    pub at: (i32, i32),
    /// Which part of the text is there.
    pub side: HPos,
    /// It.
    pub text: String,
}

impl Labels {
    /// For text of so many pixels within left, top, right and bottom.
    pub fn new(text: i32, bounds: Box2) -> Labels {
        Labels { text, bounds }
    }

    /// The labels that have a place, and what the numbers among them stand for, from 1 on.
    pub fn place(&self, points: &[((i32, i32), String)]) -> (Vec<Label>, Vec<String>) {
        let (r, height) = (self.text / 2, self.text);
        let mut taken: Vec<Box2> =
            points.iter().map(|&((x, y), _)| (x - r / 2, y - r / 2, x + r / 2, y + r / 2)).collect();
        let (mut placed, mut numbered) = (Vec::new(), Vec::new());
        for (number, ((x, y), text)) in points.iter().enumerate() {
            // Above or below first: lines go through the point itself.
            let candidates = [
                (HPos::Left, x + r, y - height - r / 3),
                (HPos::Left, x + r, y + r / 3),
                (HPos::Left, x + r, y - height / 2),
                (HPos::Right, x - r, y - height - r / 3),
                (HPos::Right, x - r, y + r / 3),
                (HPos::Right, x - r, y - height / 2),
                (HPos::Center, *x, y - r - height),
                (HPos::Center, *x, y + r),
            ];
            let mut put = |text: &str| {
                let found = candidates.iter().find(|&&(side, left, top)| {
                    let own = self.around(side, (left, top), text);
                    let is_inside = own.0 >= self.bounds.0
                        && own.1 >= self.bounds.1
                        && own.2 <= self.bounds.2
                        && own.3 <= self.bounds.3;
                    is_inside && taken.iter().enumerate().all(|(i, other)| i == number || !overlap(own, *other))
                });
                let Some(&(side, x, y)) = found else { return false };
                taken.push(self.around(side, (x, y), text));
                placed.push(Label { at: (x, y), side, text: text.to_owned() });
                true
            };
            if !text.is_empty() && !put(text) {
                numbered.push(text.clone());
                put(&numbered.len().to_string());
            }
        }
        (placed, numbered)
    }

    /// The box of a text, a little wider than it is in most fonts.
    fn around(&self, side: HPos, (x, y): (i32, i32), text: &str) -> Box2 {
        let width = (text.chars().count() as f64 * f64::from(self.text) * 0.58) as i32;
        let left = match side {
            HPos::Left => x,
            HPos::Center => x - width / 2,
            HPos::Right => x - width,
        };
        (left, y, left + width, y + self.text)
    }
}

fn overlap(a: Box2, b: Box2) -> bool {
    a.0 < b.2 && b.0 < a.2 && a.1 < b.3 && b.1 < a.3
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn labels_cover_nothing() {
        let points: Vec<_> = (0..60).map(|i| ((40 + i * 37 % 400, 30 + i * 53 % 300), format!("method {i}"))).collect();
        let labels = Labels::new(12, (0, 0, 500, 360));
        let (placed, numbered) = labels.place(&points);
        let is_number = |label: &Label| label.text.parse::<usize>().is_ok();
        let with_name = placed.iter().filter(|label| !is_number(label)).count();
        assert!(with_name > 20 && with_name + numbered.len() == points.len(), "{with_name}, {}", numbered.len());
        for label in placed.iter().filter(|label| is_number(label)) {
            let number: usize = label.text.parse().unwrap();
            assert!(points.iter().any(|(_, text)| *text == numbered[number - 1]), "{number}");
        }
        let boxes: Vec<Box2> = placed.iter().map(|label| labels.around(label.side, label.at, &label.text)).collect();
        for (i, a) in boxes.iter().enumerate() {
            assert!(boxes[..i].iter().all(|b| !overlap(*a, *b)));
            assert!(a.0 >= 0 && a.1 >= 0 && a.2 <= 500 && a.3 <= 360);
        }
    }
}
