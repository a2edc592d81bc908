//! One picture by several devices at once, block by block, with the bits of one device.

use super::blocks::render_blocks_at;
use super::{Picture, PictureBlocks};
use crate::error::Result;
use crate::pack::SceneBuffers;
use crate::several::{Devices, HandOn, Pace, Pieces, Watcher, share_out};
use crate::tracer::{Backend, DeviceShare, Finished, Progress};
use std::time::Duration;

/// Takes blocks that are finished, each once; called by the threads of the devices.
pub type TakeBlocks<'a> = &'a (dyn Fn(&Finished) -> Result<()> + Sync);

/// The blocks of a picture.
struct BlocksOf<'a> {
    picture: &'a Picture,
    blocks: &'a PictureBlocks,
    take: TakeBlocks<'a>,
}

/// So long takes what a device has of bands at a time, at the most: about what waits for others before it is written.
const IN_ORDER: Duration = Duration::from_secs(4);

impl Pieces for BlocksOf<'_> {
    fn most_time(&self) -> Option<Duration> {
        self.blocks.are_bands().then_some(IN_ORDER)
    }

    fn work(
        &self,
        (tracer, buffers): (&mut dyn Backend, &SceneBuffers),
        (numbers, pace): (&[usize], &mut Pace),
        hand_on: HandOn,
        progress: Progress,
    ) -> Result<()> {
        let mut done = |finished: &Finished| {
            hand_on(finished.blocks, &mut || (self.take)(finished));
            Ok(())
        };
        let BlocksOf { picture, blocks, .. } = *self;
        render_blocks_at(pace, (tracer, buffers), picture, blocks, (numbers, None), &mut done, progress).map(drop)
    }
}

/// Renders the `wanted` blocks of a picture by all of `devices`. Returns what each did.
///
/// # Errors
/// The last device has failed, too; and those of `take` and of `watcher`.
pub fn render_by_several(
    devices: Devices,
    picture: &Picture,
    (blocks, wanted): (&PictureBlocks, &[usize]),
    take: TakeBlocks,
    watcher: &dyn Watcher,
) -> Result<Vec<DeviceShare>> {
    picture.samples.check(picture.size)?;
    let units = blocks.units_of(wanted, devices.devices.len());
    share_out(devices, units, &BlocksOf { picture, blocks, take }, watcher)
}
