//! Twin of `cl/traverse/grid.cl`: the walk through a uniform grid. The reasons are there.

use super::leaf::{test_leaf, test_triangles};
use crate::bounds::SLACK;
use crate::layout::Float4;
use crate::options::TraceOptions;
use crate::pack::SceneBuffers;
use crate::reference::shared::math::{max_or, min_or};
use crate::reference::shared::memory::{Work, load_bounds, load_node};
use crate::reference::shared::ray::{Ray, no_hit_yet};
use crate::shared::{Hit, WorkCounter};

#[derive(Clone, Copy)]
struct GridAxis {
    low: f32,
    size: f32,
    origin: f32,
    origin_low: f32,
    inv_direction: f32,
    cell: i32,
    last: i32,
    step: i32,
    t_next: f32,
}

impl GridAxis {
    #[inline(always)]
    fn new([low, size, per_unit]: &[Float4; 3], axis: usize, count: i32, ray: &Ray, t_start: f32) -> GridAxis {
        let (origin, direction) = (ray.origin[axis], ray.direction[axis]);
        let mut this = GridAxis {
            low: low.xyz()[axis],
            size: size.xyz()[axis],
            origin,
            origin_low: ray.origin_low[axis],
            inv_direction: ray.inv_direction[axis],
            cell: 0,
            last: 0,
            step: if direction < 0.0 { -1 } else { 1 },
            t_next: 0.0,
        };
        let from_low = t_start.mul_add(direction, -((this.low - origin) - this.origin_low));
        let guess = min_or(max_or(from_low * per_unit.xyz()[axis], 0.0), (count - 1) as f32);
        this.cell = guess as i32;
        while this.cell > 0 && from_low < this.plane(this.cell) - this.low {
            this.cell -= 1;
        }
        while this.cell < count - 1 && from_low > this.plane(this.cell + 1) - this.low {
            this.cell += 1;
        }
        this.last = if !this.inv_direction.is_finite() {
            this.cell
        } else if direction < 0.0 {
            0
        } else {
            count - 1
        };
        this.t_next = this.next_t();
        this
    }

    #[inline(always)]
    fn plane(&self, k: i32) -> f32 {
        (k as f32).mul_add(self.size, self.low)
    }

    #[inline(always)]
    fn next_t(&self) -> f32 {
        if self.cell == self.last {
            return f32::INFINITY;
        }
        ((self.plane(self.cell + i32::from(self.step > 0)) - self.origin) - self.origin_low) * self.inv_direction
    }

    #[inline(always)]
    fn step(&mut self) {
        self.cell += self.step;
        self.t_next = self.next_t();
    }
}

/// Twin of `cl/traverse/grid.cl`.
#[inline(always)]
pub fn traverse_grid(
    buffers: &SceneBuffers,
    options: &TraceOptions,
    ray: &Ray,
    any_hit: bool,
    work: &mut impl Work,
) -> Hit {
    let (low, high) = (load_bounds(buffers, 0, work).xyz(), load_bounds(buffers, 4, work).xyz());
    let distance = ray.farthest_distance(low, high);
    let mut hit = no_hit_yet(ray);
    let reach = load_bounds(buffers, 3, work);
    let is_within_reach = distance <= reach.x; // false for NaN
    if !is_within_reach {
        let all = reach.y.to_bits() as usize..buffers.references.len();
        test_triangles(buffers, options, ray, all, 0, any_hit, &mut hit, work);
        return hit;
    }
    let outside = reach.y.to_bits() as usize;
    let outside = outside..outside + reach.z.to_bits() as usize;
    if test_triangles(buffers, options, ray, outside, 0, any_hit, &mut hit, work) {
        return hit;
    }
    let Some((t_near, t_far)) = ray.clip_to_thick_box(SLACK * distance, low, high) else {
        return hit;
    };
    let bounds = [buffers.bounds[0], load_bounds(buffers, 1, work), load_bounds(buffers, 2, work)];
    let count = bounds.map(|axis| axis.w.to_bits() as i32);
    let mut x = GridAxis::new(&bounds, 0, count[0], ray, t_near);
    let mut y = GridAxis::new(&bounds, 1, count[1], ray, t_near);
    let mut z = GridAxis::new(&bounds, 2, count[2], ray, t_near);
    loop {
        let cell = load_node(buffers, ((z.cell * count[1] + y.cell) * count[0] + x.cell) as usize, work);
        if test_leaf(buffers, options, ray, &cell, any_hit, &mut hit, work) {
            return hit;
        }
        let t_next = min_or(x.t_next, min_or(y.t_next, z.t_next));
        if !(t_next <= t_far && t_next <= hit.t) {
            return hit;
        }
        work.count(WorkCounter::Steps, 1);
        if x.t_next == t_next {
            x.step();
        } else if y.t_next == t_next {
            y.step();
        } else {
            z.step();
        }
    }
}
