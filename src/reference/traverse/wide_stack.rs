//! Twin of `cl/traverse/wide_stack.cl`. The reasons are there.

use crate::shared::BVH_END;

/// A child to be visited later, and where the ray enters it.
#[derive(Clone, Copy, Default)]
pub struct FarChild {
    /// To the child.
    pub link: u32,
    /// Where the ray enters it.
    pub t_enter: f32,
}

/// What waits. The first entry is the end, which is entered before everything.
pub struct WideStack {
    entries: Vec<FarChild>,
    /// Those that wait, apart from the end.
    stacked: usize,
}

impl WideStack {
    /// Nothing yet; it has room for so many entries, the end included.
    #[inline(always)]
    pub fn new(entries: u32) -> WideStack {
        let mut entries = vec![FarChild::default(); entries as usize];
        entries[0] = FarChild { link: BVH_END, t_enter: f32::NEG_INFINITY };
        WideStack { entries, stacked: 0 }
    }

    /// Puts the children that are met on it: the nearest three on top, the nearest of them topmost, and of two at the
    /// same t the first one. The others, and where any hit will do all, are in their own order.
    #[inline(always)]
    pub fn push(&mut self, met: impl Iterator<Item = FarChild>, any_hit: bool) {
        let mut near = [FarChild::default(); 3];
        let mut count = 0;
        for mut child in met {
            if !any_hit {
                for near in &mut near[..count] {
                    if child.t_enter < near.t_enter {
                        std::mem::swap(near, &mut child);
                    }
                }
                if count < near.len() {
                    near[count] = child;
                    count += 1;
                    continue;
                }
            }
            self.stacked += 1;
            self.entries[self.stacked] = child;
        }
        for child in near[..count].iter().rev() {
            self.stacked += 1;
            self.entries[self.stacked] = *child;
        }
    }

    /// How many wait.
    #[inline(always)]
    pub fn depth(&self) -> u32 {
        self.stacked as u32
    }

    /// The next child that is not entered behind the hit, or the end.
    #[inline(always)]
    pub fn next(&mut self, t_limit: f32) -> u32 {
        while t_limit < self.entries[self.stacked].t_enter {
            self.stacked -= 1;
        }
        let link = self.entries[self.stacked].link;
        self.stacked = self.stacked.wrapping_sub(1); // the end's place is never asked for again
        link
    }
}
