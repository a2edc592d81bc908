//! Ticks that people can read.

/// An axis in its own units: the value, or its logarithm to the base 10.
#[derive(Debug, Clone, PartialEq)]
pub struct Axis {
    /// One end.
    pub low: f64,
    /// The other one, above it.
    pub high: f64,
    /// Where there is a number, within the ends.
    pub ticks: Vec<f64>,
    /// Whether units are logarithms.
    pub is_log: bool,
}

impl Axis {
    /// An axis that shows all `values`, which are above 0 if it is logarithmic; with fewer ticks if there is little
    /// room.
    pub fn around(values: impl Iterator<Item = f64>, is_log: bool, is_short: bool) -> Axis {
        let unit = |value: f64| if is_log { value.log10() } else { value };
        let (low, high) = values
            .filter(|value| value.is_finite())
            .map(unit)
            .fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), value| (low.min(value), high.max(value)));
        let (low, high) = if low > high { (0.0, 1.0) } else { (low, high) };
        let most = if is_short { 5 } else { 8 };
        match is_log {
            true => Axis::logarithmic(low, high, most),
            false => Axis::linear(low, high, most),
        }
    }

    fn linear(low: f64, high: f64, most: usize) -> Axis {
        // Speeds and errors begin at 0, so that lengths tell ratios.
        let low = if low >= 0.0 { 0.0 } else { low };
        let high = if high > low { high } else { low + 1.0 };
        let step = nice_step((high - low) / most as f64);
        let first = (low / step).floor() as i64;
        let last = (high / step * (1.0 + 1e-9)).ceil() as i64;
        let ticks: Vec<f64> = (first..=last).map(|i| i as f64 * step).collect();
        Axis { low: first as f64 * step, high: last as f64 * step, ticks, is_log: false }
    }

    fn logarithmic(low: f64, high: f64, most: usize) -> Axis {
        let room = ((high - low) * 0.04).max(0.08);
        let (low, high) = (low - room, high + room);
        let decades = high - low;
        let ticks = match decades {
            // Round numbers between the ends.
            ..1.0 => {
                let [low, high] = [low, high].map(|end| 10f64.powf(end));
                let step = nice_step((high - low) / 4.0);
                let steps = (low / step).ceil() as i64..=(high / step).floor() as i64;
                steps.map(|i| (i as f64 * step).log10()).collect()
            }
            // 1, 2 and 5 of each decade.
            ..2.2 => (low.floor() as i64..=high.ceil() as i64)
                .flat_map(|i| [1.0_f64, 2.0, 5.0].map(|digit| i as f64 + digit.log10()))
                .collect::<Vec<f64>>(),
            _ => {
                let step = (decades / most as f64).ceil().max(1.0) as i64;
                let first = (low.floor() as i64).div_euclid(step) * step;
                (first..=high.ceil() as i64).step_by(step as usize).map(|i| i as f64).collect()
            }
        };
        let ticks = ticks.into_iter().filter(|tick| (low..=high).contains(tick)).collect();
        Axis { low, high, ticks, is_log: true }
    }

    /// Where a value is.
    pub fn place(&self, value: f64) -> f64 {
        if self.is_log { value.log10() } else { value }
    }

    /// The value there.
    pub fn value(&self, place: f64) -> f64 {
        if self.is_log { 10f64.powf(place) } else { place }
    }
}

/// The next of 1, 2, 5, 10, ... from `step` on.
fn nice_step(step: f64) -> f64 {
    let unit = 10f64.powf(step.log10().floor());
    [1.0, 2.0, 5.0, 10.0]
        .map(|digit| digit * unit)
        .into_iter()
        .find(|&nice| nice >= step * (1.0 - 1e-9))
        .unwrap_or(step)
}

/// A number of three digits, with k, M or G, or a power of ten.
pub fn short(value: f64) -> String {
    let size = value.abs();
    if size == 0.0 {
        return "0".to_owned();
    }
    if !(1e-3..1e12).contains(&size) {
        return power(value);
    }
    let (number, unit) = match size {
        1e9.. => (value / 1e9, "G"),
        1e6.. => (value / 1e6, "M"),
        1e4.. => (value / 1e3, "k"),
        _ => (value, ""),
    };
    let decimals = match number.abs() {
        100.0.. => 0,
        10.0.. => 1,
        1.0.. => 2,
        _ => 3,
    };
    let text = format!("{number:.decimals$}");
    let text = if text.contains('.') { text.trim_end_matches('0').trim_end_matches('.') } else { &text };
    format!("{text}{unit}")
}

fn power(value: f64) -> String {
    let text = format!("{value:.1e}");
    match text.split_once('e') {
        Some((digits, exponent)) => format!("{}e{exponent}", digits.trim_end_matches(".0")),
        None => text,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_short() {
        let cases = [
            (0.0, "0"),
            (0.5, "0.5"),
            (12.34, "12.3"),
            (1234.0, "1234"),
            (12_345.0, "12.3k"),
            (2e6, "2M"),
            (1e-20, "1e-20"),
            (3.25e15, "3.2e15"),
            (0.1234, "0.123"),
            (100.0, "100"),
        ];
        for (value, expected) in cases {
            assert_eq!(short(value), expected);
        }
    }

    #[test]
    fn ticks_are_round_and_within_the_axis() {
        for (values, is_log) in [
            (vec![3.0, 17.0], false),
            (vec![0.2], false),
            (vec![1e-20, 1e18], true),
            (vec![3.0, 8.0], true),
            (vec![5.0], true),
            (vec![], false),
        ] {
            let axis = Axis::around(values.iter().copied(), is_log, false);
            assert!(axis.low < axis.high && axis.ticks.len() >= 2 && axis.ticks.len() <= 12, "{values:?} {axis:?}");
            assert!(
                axis.ticks.is_sorted() && axis.ticks.iter().all(|t| (axis.low..=axis.high).contains(t)),
                "{axis:?}"
            );
            assert!(values.iter().all(|&v| (axis.low..=axis.high).contains(&axis.place(v))), "{axis:?}");
        }
        assert_eq!(Axis::around([17.0].into_iter(), false, true).ticks, [0.0, 5.0, 10.0, 15.0, 20.0]);
    }
}
