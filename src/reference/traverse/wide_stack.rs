//! Twin of `cl/traverse/wide_stack.cl`. The reasons are there.

use crate::shared::{FIRST_KEY, KEY_LANE};

/// Children of a node, and triangles of a packet.
pub const WIDTH: usize = 8;

/// What waits: keys, and the numbers of the nodes whose children they are. The first entry is the end.
pub struct WideStack {
    entries: Vec<(u32, u32)>,
    /// Those that wait, apart from the end.
    stacked: usize,
}

/// When a child is entered, rounded down, and its number in its node.
#[inline(always)]
fn key(lane: usize, t_enter: f32, any_hit: bool) -> u32 {
    let bits = t_enter.to_bits();
    let rounded = bits.wrapping_add(KEY_LANE * (bits >> 31)) & !KEY_LANE;
    (if any_hit { FIRST_KEY } else { rounded }) | lane as u32
}

impl WideStack {
    /// Nothing yet; it has room for so many entries, the end included.
    #[inline(always)]
    pub fn new(entries: u32) -> WideStack {
        let mut entries = vec![(0, 0); entries as usize];
        entries[0] = (FIRST_KEY, 0);
        WideStack { entries, stacked: 0 }
    }

    /// Puts the children of a node that are met on it, by their numbers and when they are entered: the nearest on top,
    /// or where any hit will do the first.
    #[inline(always)]
    pub fn push(&mut self, node: u32, met: impl Iterator<Item = (usize, f32)>, any_hit: bool) {
        let first = self.stacked + 1;
        for (lane, t_enter) in met {
            self.stacked += 1;
            self.entries[self.stacked] = (key(lane, t_enter, any_hit), node);
        }
        self.entries[first..=self.stacked].sort_unstable_by(|a, b| b.cmp(a));
    }

    /// How many wait.
    #[inline(always)]
    pub fn depth(&self) -> u32 {
        self.stacked as u32
    }

    /// The nearest child that is not entered behind the hit: its node, and its number in that; `None` if there is none.
    #[inline(always)]
    pub fn next(&mut self, t_limit: f32) -> Option<(u32, usize)> {
        while t_limit < f32::from_bits(self.entries[self.stacked].0 & !KEY_LANE) {
            self.stacked -= 1;
        }
        let (key, node) = self.entries[self.stacked];
        self.stacked = self.stacked.checked_sub(1)?;
        Some((node, (key & KEY_LANE) as usize))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// However close the limit is to where a child is entered, it is not left out too early, also below 0.
    #[test]
    fn what_is_entered_at_the_limit_is_not_left_out() {
        for t in [0.0, 1.0f32.next_down(), 1.0, 3.7, 1e-40, -1e-40, -1.0, (-1.0f32).next_up(), -3.7] {
            for lane in 0..8 {
                let mut stack = WideStack::new(9);
                stack.push(5, [(lane, t)].into_iter(), false);
                assert_eq!(stack.next(t), Some((5, lane)), "{t}");
                assert_eq!(stack.next(t), None);
                let mut stack = WideStack::new(9);
                stack.push(5, [(lane, t)].into_iter(), false);
                let before = t - t.abs() * 1e-5 - 1e-39;
                assert_eq!(stack.next(before), None, "{t}");
            }
        }
    }

    #[test]
    fn the_nearest_come_first_and_where_any_hit_will_do_the_first() {
        let enters = [3.0, 0.5, 7.0, 0.5, 2.0];
        for (any_hit, expected) in [(false, [1, 3, 4, 0, 2]), (true, [0, 1, 2, 3, 4])] {
            let mut stack = WideStack::new(9);
            stack.push(5, enters.into_iter().enumerate(), any_hit);
            let order: Vec<_> = std::iter::from_fn(|| stack.next(f32::INFINITY)).map(|(_, lane)| lane).collect();
            assert_eq!(order, expected);
        }
    }
}
