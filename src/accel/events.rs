//! Large nodes of the surface area heuristic: sorted event lists.
//!
//! Wald and Havran, "On building fast kd-trees for ray tracing, and on doing that in O(N log N)", IEEE Symposium on
//! Interactive Ray Tracing 2006, section 4.3. Events are sorted once, at the root. A split passes them on in order;
//! only the triangles that straddle the plane get new events, which are sorted apart and merged in.
//!
//! Bad at: nodes of a few triangles, where lists cost more than they save ([`super::small`]).

use super::clip::Reference;
use super::cost::{Costs, Side, Split};
use super::subtree::Cell;
use crate::parallel;
use glam::Vec3;

/// Where a reference begins, lies or ends on an axis; sorted by position, and there ends before planar ones before
/// starts.
///
/// ```text
/// bits 63-32  position, as an integer in the order of the numbers
/// bits 31-30  kind: END, PLANAR or START
/// bits 29-0   number of the reference in its node
/// ```
type Event = u64;

const END: u64 = 0;
const PLANAR: u64 = 1;
const START: u64 = 2;
const KIND_SHIFT: u32 = 30;
const REFERENCE_BITS: u64 = (1 << KIND_SHIFT) - 1;

/// The most references that a node can have: what bits 29-0 of an event can number.
pub(super) const MAX_REFERENCES: usize = 1 << KIND_SHIFT;

/// Nodes of at least this many references see to their axes side by side.
const PARALLEL_AXES: usize = 1 << 12;

const SIGN_BIT: u32 = 1 << 31;

/// Maps float32 numbers to integers in the same order; -0 must not occur.
pub(super) fn ordered(x: f32) -> u64 {
    let bits = x.to_bits();
    u64::from(if bits & SIGN_BIT == 0 { bits | SIGN_BIT } else { !bits })
}

/// The position of an event.
fn position(event: Event) -> f32 {
    let ordered = (event >> 32) as u32;
    f32::from_bits(if ordered & SIGN_BIT == 0 { !ordered } else { ordered ^ SIGN_BIT })
}

/// How many events a reference has on an axis.
fn event_count(axis: usize, reference: &Reference) -> usize {
    if reference.low[axis] == reference.high[axis] { 1 } else { 2 }
}

/// Sees to the axes of a node of `count` references.
fn for_each_axis<I: Iterator<Item: Send>>(count: usize, axes: I, work: impl Fn(I::Item) + Sync) {
    if count >= PARALLEL_AXES { parallel::each(axes, work) } else { axes.for_each(work) }
}

fn push_events(events: &mut Vec<Event>, axis: usize, reference: &Reference, number: usize) {
    let (low, high) = (ordered(reference.low[axis]) << 32, ordered(reference.high[axis]) << 32);
    if low == high {
        events.push(low | PLANAR << KIND_SHIFT | number as u64);
    } else {
        events.push(low | START << KIND_SHIFT | number as u64);
        events.push(high | END << KIND_SHIFT | number as u64);
    }
}

/// A node with its references, ascending by triangle, and their events on each axis, sorted.
#[derive(Debug)]
pub(super) struct EventNode {
    pub references: Vec<Reference>,
    events: [Vec<Event>; 3],
}

impl EventNode {
    /// The root node: sorts the events of all references.
    pub fn new(references: Vec<Reference>) -> EventNode {
        let sorted = |axis| {
            let mut events = Vec::with_capacity(2 * references.len());
            for (number, reference) in references.iter().enumerate() {
                push_events(&mut events, axis, reference, number);
            }
            events.sort_unstable();
            events
        };
        let mut events: [Vec<Event>; 3] = Default::default();
        parallel::each_mut(&mut events, |axis, events| *events = sorted(axis));
        EventNode { references, events }
    }

    /// The cheapest split: one sweep over the events of each axis (algorithm 2 of the paper).
    pub fn best_split(&self, cell: &Cell, costs: &Costs) -> Option<Split> {
        let mut splits = [None; 3];
        let find = |(axis, split): (usize, &mut Option<Split>)| *split = self.best_split_on(axis, cell, costs);
        for_each_axis(self.references.len(), splits.iter_mut().enumerate(), find);
        splits.into_iter().flatten().reduce(|best, split| if split.is_better_than(&best) { split } else { best })
    }

    fn best_split_on(&self, axis: usize, cell: &Cell, costs: &Costs) -> Option<Split> {
        let plane_cost = costs.across(cell, axis)?;
        let events = &self.events[axis];
        let mut best: Option<Split> = None;
        let (mut left, mut right) = (0, self.references.len() as u32);
        let mut next = 0;
        while next < events.len() {
            let at = events[next] >> 32;
            let plane = position(events[next]);
            let mut kinds = [0; 3];
            while next < events.len() && events[next] >> 32 == at {
                kinds[(events[next] >> KIND_SHIFT & 3) as usize] += 1;
                next += 1;
            }
            let planar = kinds[PLANAR as usize];
            right -= kinds[END as usize] + planar;
            if cell.is_split_by(axis, plane) {
                let split = plane_cost.split(plane, left, planar, right);
                // Planes come in ascending order, so the first of equals is kept, as `is_better_than` demands.
                if best.is_none_or(|best| split.cost < best.cost) {
                    best = Some(split);
                }
            }
            left += kinds[START as usize] + planar;
        }
        best
    }

    /// The two sides of a split (section 4.3 of the paper), straddling references clipped to both.
    pub fn split(self, vertices: &[[Vec3; 3]], cell: &Cell, split: &Split) -> (EventNode, EventNode) {
        let count = self.references.len();
        let mut left = Child::with_capacity(count);
        let mut right = Child::with_capacity(count);
        // For each reference its side and its number there, as an event holds them.
        let mut places = Vec::with_capacity(count);

        // Step 1: classify the references.
        for reference in &self.references {
            let side = split.side_of(reference.low[split.axis], reference.high[split.axis]);
            let place = (side as u32) << KIND_SHIFT;
            places.push(match side {
                Side::Left => place | left.push(*reference) as u32,
                Side::Right => place | right.push(*reference) as u32,
                Side::Both => {
                    // Step 2: make new references and events for those that straddle the plane.
                    let (below, above) = reference.split(vertices, cell, split.axis, split.plane);
                    left.push_new(below);
                    right.push_new(above);
                    place
                }
            });
        }

        // Step 3: pass the old events on in their order; step 4: merge the new ones in.
        let axes = self.events.into_iter().zip(left.events.iter_mut().zip(&mut right.events)).enumerate();
        let of_right = &right.references;
        for_each_axis(count, axes, |(axis, (events, (left, right))): (_, (_, (&mut AxisEvents, &mut AxisEvents)))| {
            let right_count = of_right.iter().map(|reference| event_count(axis, reference)).sum();
            (left.old, right.old) = pass_on(events, &places, right_count);
            left.merge();
            right.merge();
        });
        (left.node(), right.node())
    }
}

/// Distributes events without a branch on the side, which would be a coin toss on two of the three axes. Those of the
/// left side take the place of all; there are `of_right` others, with those that are to be merged in.
fn pass_on(mut events: Vec<Event>, places: &[u32], of_right: usize) -> (Vec<Event>, Vec<Event>) {
    let mut right = vec![0; of_right + 1];
    let (mut left_count, mut right_count) = (0, 0);
    for number in 0..events.len() {
        let event = events[number];
        let place = u64::from(places[(event & REFERENCE_BITS) as usize]);
        let side = place >> KIND_SHIFT;
        let renumbered = event & !REFERENCE_BITS | place & REFERENCE_BITS;
        events[left_count] = renumbered;
        right[right_count] = renumbered;
        left_count += usize::from(side == Side::Left as u64);
        right_count += usize::from(side == Side::Right as u64);
    }
    events.truncate(left_count);
    right.truncate(right_count);
    (events, right)
}

/// The events of one side of a split on one axis: those of references that were there before, sorted, and of new ones.
#[derive(Default)]
struct AxisEvents {
    old: Vec<Event>,
    new: Vec<Event>,
}

impl AxisEvents {
    /// Merges the new events in from the back, in place.
    fn merge(&mut self) {
        let (old, new) = (&mut self.old, &mut self.new);
        new.sort_unstable();
        let mut old_count = old.len();
        old.resize(old_count + new.len(), 0);
        for (new_count, &new_event) in new.iter().enumerate().rev() {
            while old_count > 0 && old[old_count - 1] > new_event {
                old_count -= 1;
                old[old_count + new_count + 1] = old[old_count];
            }
            old[old_count + new_count] = new_event;
        }
    }
}

/// One side of a split while it is filled.
struct Child {
    references: Vec<Reference>,
    events: [AxisEvents; 3],
}

impl Child {
    fn with_capacity(count: usize) -> Child {
        Child { references: Vec::with_capacity(count), events: Default::default() }
    }

    /// Adds a reference and tells its number.
    fn push(&mut self, reference: Reference) -> usize {
        self.references.push(reference);
        self.references.len() - 1
    }

    /// Adds a reference that was clipped, if something of it is left, with new events.
    fn push_new(&mut self, reference: Option<Reference>) {
        if let Some(reference) = reference {
            let number = self.push(reference);
            for (axis, events) in self.events.iter_mut().enumerate() {
                push_events(&mut events.new, axis, &reference, number);
            }
        }
    }

    fn node(self) -> EventNode {
        EventNode { references: self.references, events: self.events.map(|events| events.old) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn positions_keep_order_and_value() {
        let numbers = [f32::MIN, -1e18, -1.0, -1e-40, 0.0, 1e-40, 1e-20, 1.0, 3e38];
        for pair in numbers.windows(2) {
            assert!(ordered(pair[0]) < ordered(pair[1]), "{pair:?}");
        }
        for x in numbers {
            assert_eq!(position(ordered(x) << 32), x);
        }
    }

    #[test]
    fn merging_keeps_the_order() {
        let mut events = AxisEvents { old: vec![2, 4, 6, 8], new: vec![9, 1, 5] };
        events.merge();
        assert_eq!(events.old, [1, 2, 4, 5, 6, 8, 9]);
    }
}
