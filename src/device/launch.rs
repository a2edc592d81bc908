//! How many work-items one launch may have, and passing arguments to kernels.

use super::rows::Rows;
use super::{Buffer, DeviceContext, DeviceInfo, DeviceKind, Event, Kernel, KernelArg};
use crate::error::Result;
use crate::tracer::STOPPABLE_LAUNCH_S;
use bytemuck::Pod;
use std::ops::Range;

/// Work is cut into launches of about so many seconds, so that desktops stay alive and watchdogs (typically 2 s) quiet.
const LAUNCH_S: f64 = 0.1;
/// The same of GPUs that have neither. At the end of each launch most of a GPU waits for its slowest pixels.
const LAUNCH_S_UNLIMITED: f64 = 0.3;
/// CPUs have no watchdog, and at the end of each launch their threads wait for the last one.
const LAUNCH_S_CPU: f64 = 1.0;
/// The first launch of a kernel, whose speed is not known yet, has this many samples or rays: 0.1 s at 40,000 rays a
/// second, which is slower than any device that was seen.
pub(super) const FIRST_ITEMS: usize = 4096;
/// GPUs are not full with that; 16 times as much is still a moment on the smallest.
pub(super) const FIRST_ITEMS_GPU: usize = 1 << 16;
/// A compute unit of a GPU has about so many work-items at once: 2048 on NVIDIA's, 2560 and 2048 on AMD's.
const ITEMS_OF_UNIT: usize = 2048;
/// A launch is at most this many times as large as the largest one before: one part of a picture may be much slower
/// than another.
const GROWTH: usize = 2;

/// How many work-items a launch may have, learnt from the launches before.
#[derive(Debug)]
pub(super) struct LaunchPlan {
    launch_s: f64,
    largest: usize,
    seconds_per_item: f64,
    /// How many times dearer the next items may be than the last ones.
    caution: f64,
    /// Of calls that may be stopped what limits launches more.
    short: Option<Short>,
}

/// Limits of launches that are to be short wherever they are: one part of a picture may be a hundred times as dear as
/// the one before, and a camera may move in the middle of it.
#[derive(Debug, Clone, Copy)]
struct Short {
    /// Items that a launch may always have.
    first: usize,
    /// Seconds that an item took where they took most.
    dearest_s: f64,
}

/// Items of another kind may be so many times dearer: a launch is still far from what watchdogs allow if they are even
/// more so.
const OTHER_ITEMS: f64 = 8.0;

/// Seconds that a launch on a device is to take.
fn launch_s(info: &DeviceInfo) -> f64 {
    match info.kind {
        DeviceKind::Cpu => LAUNCH_S_CPU,
        _ if info.limits_kernel_time => LAUNCH_S,
        _ => LAUNCH_S_UNLIMITED,
    }
}

impl LaunchPlan {
    /// A plan of launches that take about so many seconds, and of which the first has about `first` items.
    fn starting_with(first: usize, launch_s: f64) -> Self {
        LaunchPlan {
            launch_s,
            largest: first.max(1).div_ceil(GROWTH),
            seconds_per_item: 0.0,
            caution: 1.0,
            short: None,
        }
    }

    /// A plan for a device that is open, whose launches are short where something may stop them.
    pub fn on(context: &DeviceContext, first: usize) -> Self {
        let info = context.info();
        let plan = LaunchPlan::starting_with(first, launch_s(info));
        // What a GPU has at once takes as long as the slowest of it, and less of it takes no less.
        let at_once = if info.kind == DeviceKind::Gpu { info.compute_units as usize * ITEMS_OF_UNIT } else { 0 };
        if context.is_stoppable() { plan.stoppable(first.max(at_once)) } else { plan }
    }

    fn stoppable(self, first: usize) -> Self {
        LaunchPlan { launch_s: STOPPABLE_LAUNCH_S, short: Some(Short { first, dearest_s: 0.0 }), ..self }
    }

    /// Seconds that an item took where they took most; 0 unless something may stop the launches.
    pub fn dearest_s(&self) -> f64 {
        self.short.map_or(0.0, |short| short.dearest_s)
    }

    /// Expects items that take so many seconds.
    pub fn expect(&mut self, dearest_s: f64) {
        self.short.iter_mut().for_each(|short| short.dearest_s = short.dearest_s.max(dearest_s));
    }

    /// The next launches have other items than those before.
    pub fn begin_others(&mut self) {
        self.caution = OTHER_ITEMS;
    }

    /// Items of the next launch when `left` remain; a multiple of `multiple` unless it is the last.
    pub fn next(&self, left: usize, multiple: usize) -> usize {
        let in_time = (self.launch_s / (self.caution * self.seconds_per_item).max(1e-12)) as usize;
        let most = self.short.map_or(usize::MAX, |short| {
            let in_time = (self.launch_s / short.dearest_s.max(1e-12)) as usize;
            in_time.max(short.first)
        });
        let items = in_time.clamp(1, GROWTH * self.largest).min(most).next_multiple_of(multiple);
        // A rest of less than half a launch goes along: its own launch would leave units idle twice.
        if items + items / 2 >= left { left } else { items }
    }

    /// Seconds that a launch of `items` items may take, if something is known of such items.
    pub fn estimate(&self, items: usize) -> Option<f64> {
        (self.seconds_per_item > 0.0).then_some(self.caution * self.seconds_per_item * items as f64)
    }

    /// Learns from a launch of `items` items.
    pub fn learn(&mut self, items: usize, seconds: f64) {
        self.learn_from_several(items, items, seconds);
    }

    /// Learns from several launches: the largest number of items in one, how many items of all had work, and the
    /// seconds of all.
    pub fn learn_from_several(&mut self, largest: usize, busy: usize, seconds: f64) {
        if busy > 0 {
            self.seconds_per_item = seconds / busy as f64;
            self.caution = 1.0;
            self.largest = self.largest.max(largest);
            // A tiny launch takes as long as its begin and its end do, or as its slowest item.
            let first = self.short.map_or(1, |short| short.first.max(1));
            self.expect(self.seconds_per_item * (largest as f64 / first as f64).min(1.0));
        }
    }
}

/// Passes arguments to a kernel one after the other.
pub(super) struct Arguments<'a> {
    kernel: &'a mut Kernel,
    next: usize,
}

impl<'k> Arguments<'k> {
    pub fn of(kernel: &'k mut Kernel) -> Self {
        Arguments { kernel, next: 0 }
    }

    pub fn set<'a>(mut self, value: impl Into<KernelArg<'a>>) -> Result<Self> {
        self.kernel.set_arg(self.next, value)?;
        self.next += 1;
        Ok(self)
    }

    /// Passes what says in which order the rays of a batch are traced: its rows, or, where they are sorted, their
    /// numbers.
    pub fn set_order(self, rows: Rows, sorted: Option<&Buffer<u32>>) -> Result<Self> {
        let arguments = self.set(rows.length)?.set(rows.in_bands)?;
        match sorted {
            Some(sorted) => arguments.set(sorted),
            None => arguments.set(KernelArg::NULL),
        }
    }

    /// Passes the array of work records, which only kernels that count have as an argument.
    pub fn set_work<T: Pod>(self, work: &Option<Buffer<T>>) -> Result<Self> {
        match work {
            Some(work) => self.set(work),
            None => Ok(self),
        }
    }
}

/// What a kernel is launched over.
#[derive(Debug, Clone)]
pub(super) struct Shape {
    /// Rays, pixels, or samples of pixels: from this number to that.
    pub items: Range<usize>,
    /// Work-items of a work-group.
    pub work_group: usize,
    /// Rays or pixels that a work-item takes at a time.
    pub items_of_one: usize,
    /// How many work-items a launch has, if each goes on as long as it finds items that no other has taken; `None`: as
    /// many as the items fill.
    pub workers: Option<usize>,
}

impl Shape {
    /// Launches have a multiple of so many items.
    fn multiple(&self) -> usize {
        self.work_group * self.items_of_one
    }
}

/// Launches `kernel` over the items in parts, its last two arguments being the first item and the end of a part.
/// Returns seconds of device time.
pub(super) fn launch(
    kernel: &mut Kernel,
    plan: &mut LaunchPlan,
    shape: Shape,
    mut progress: impl FnMut(usize),
) -> Result<f64> {
    let mut seconds = 0.0;
    launch_parts(kernel, plan, &shape, |items, launch_s| {
        seconds += launch_s;
        progress(items);
    })?;
    Ok(seconds)
}

/// The same; if the plan has all items in one launch, that is begun alone, and the plan is to learn later how long it
/// took. Of other launches `done` is told, with the items and the seconds of each.
pub(super) fn begin_launch(
    kernel: &mut Kernel,
    plan: &mut LaunchPlan,
    shape: Shape,
    done: impl FnMut(usize, f64),
) -> Result<Option<Event>> {
    let all = shape.items.len();
    if plan.next(all, shape.multiple()) == all {
        return begin(kernel, plan, &shape, shape.items.clone()).map(Some);
    }
    launch_parts(kernel, plan, &shape, done)?;
    Ok(None)
}

fn launch_parts(
    kernel: &mut Kernel,
    plan: &mut LaunchPlan,
    shape: &Shape,
    mut done: impl FnMut(usize, f64),
) -> Result<()> {
    let mut first = shape.items.start;
    while first < shape.items.end {
        let items = plan.next(shape.items.end - first, shape.multiple());
        let launch_s = begin(kernel, plan, shape, first..first + items)?.wait()?;
        plan.learn(items, launch_s);
        first += items;
        done(items, launch_s);
    }
    Ok(())
}

fn begin(kernel: &mut Kernel, plan: &LaunchPlan, shape: &Shape, items: Range<usize>) -> Result<Event> {
    let bounds = kernel.arg_count() - 2;
    kernel.set_arg(bounds, items.start as u32)?;
    kernel.set_arg(bounds + 1, items.end as u32)?;
    let work_items = shape.workers.unwrap_or(items.len().div_ceil(shape.items_of_one));
    let event = kernel.launch(&[work_items.next_multiple_of(shape.work_group)], Some(&[shape.work_group]))?;
    Ok(event.estimated(plan.estimate(items.len())))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn launches(total: usize, first: usize, seconds: impl Fn(usize) -> f64) -> Vec<(usize, f64)> {
        launches_of(LAUNCH_S, total, first, seconds)
    }

    /// Plans `total` items on a device that takes `seconds(item)` for each; returns the launches' items and seconds.
    fn launches_of(launch_s: f64, total: usize, first: usize, seconds: impl Fn(usize) -> f64) -> Vec<(usize, f64)> {
        let mut plan = LaunchPlan::starting_with(first, launch_s);
        let mut all = Vec::new();
        let mut done = 0;
        while done < total {
            let items = plan.next(total - done, 64);
            let time = (done..done + items).map(&seconds).sum();
            plan.learn(items, time);
            all.push((items, time));
            done += items;
        }
        assert_eq!(done, total);
        all
    }

    #[test]
    fn no_launch_is_long_on_slow_devices_or_in_slow_parts() {
        // 50,000 rays a second; a part that takes twice as long; a cost that grows a hundredfold across the picture.
        for all in [
            launches(200_000, FIRST_ITEMS, |_| 2e-5),
            launches(1_000_000, FIRST_ITEMS, |i| if (400_000..500_000).contains(&i) { 1e-5 } else { 5e-6 }),
            launches(1_000_000, FIRST_ITEMS_GPU, |i| 1e-8 + 1e-6 * (i as f64 / 1e6)),
        ] {
            let longest = all.iter().map(|launch| launch.1).fold(0.0, f64::max);
            assert!(longest <= 0.3, "{longest} s");
        }
    }

    #[test]
    fn launches_that_may_be_stopped_are_short_wherever_they_are() {
        let mut plan = LaunchPlan::starting_with(1000, LAUNCH_S_CPU).stoppable(1000);
        let mut launches = |seconds: f64| {
            let mut longest: f64 = 0.0;
            for _ in 0..20 {
                let items = plan.next(10_000_000, 1);
                plan.learn(items, items as f64 * seconds);
                longest = longest.max(items as f64 * seconds);
            }
            longest
        };
        assert!(launches(1e-6) < 0.021);
        // A dear part comes by surprise once, and not again.
        assert!(launches(1e-5) > 0.1);
        assert!(launches(1e-6) < 0.0021);
        assert!(launches(1e-5) < 0.021);
        // Not so few that a device would idle.
        assert!(launches(1e-3) <= 2.0);
        assert_eq!((plan.dearest_s(), plan.next(10_000_000, 1)), (1e-3, 20));
    }

    #[test]
    fn tiny_launches_do_not_make_those_to_come_short() {
        let mut plan = LaunchPlan::starting_with(FIRST_ITEMS, LAUNCH_S).stoppable(FIRST_ITEMS);
        plan.learn(3, 1e-4);
        for _ in 0..20 {
            let items = plan.next(100_000_000, 64);
            plan.learn(items, 1e-4 + 1e-9 * items as f64);
        }
        assert!(plan.next(100_000_000, 64) > 100 * FIRST_ITEMS);
    }

    #[test]
    fn launches_are_long_where_nothing_ends_them() {
        let limited = crate::device_info::sample_info();
        let unlimited = DeviceInfo { limits_kernel_time: false, ..limited.clone() };
        let cpu = DeviceInfo { kind: DeviceKind::Cpu, ..unlimited.clone() };
        assert_eq!([&limited, &unlimited, &cpu].map(launch_s), [LAUNCH_S, LAUNCH_S_UNLIMITED, LAUNCH_S_CPU]);
    }

    #[test]
    fn launches_on_cpus_last_a_second() {
        let all = launches_of(LAUNCH_S_CPU, 1 << 20, FIRST_ITEMS, |_| 1e-5);
        let longest = all.iter().map(|launch| launch.1).fold(0.0, f64::max);
        assert!((0.9..=1.6).contains(&longest) && all.len() <= 16, "{all:?}");
    }

    #[test]
    fn dear_items_after_cheap_ones_are_begun_with_care() {
        let mut plan = LaunchPlan::starting_with(FIRST_ITEMS_GPU, LAUNCH_S);
        plan.learn(2_000_000, 0.1);
        assert_eq!(plan.next(2_000_000, 64), 2_000_000);
        plan.begin_others();
        let first = plan.next(2_000_000, 64);
        assert!((200_000..=250_100).contains(&first), "{first}");
        plan.learn(first, 20.0 * 0.1 * first as f64 / 2e6);
        assert!(plan.next(2_000_000 - first, 64) <= 100_032);
    }

    #[test]
    fn only_what_was_learnt_is_an_estimate() {
        let mut plan = LaunchPlan::starting_with(FIRST_ITEMS_GPU, LAUNCH_S);
        assert_eq!(plan.estimate(1000), None);
        plan.learn(1000, 0.5);
        assert_eq!(plan.estimate(2000), Some(1.0));
        plan.begin_others();
        assert_eq!(plan.estimate(1000), Some(0.5 * OTHER_ITEMS));
    }

    #[test]
    fn fast_devices_get_few_launches() {
        let all = launches(16 << 20, FIRST_ITEMS_GPU, |_| 2.5e-10);
        assert!(all.len() <= 10, "{all:?}");
    }
}
