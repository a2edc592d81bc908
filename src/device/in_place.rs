//! Batches that a processor traces in place: its kernels read rays where they are made, and hits are taken where they
//! write them. That goes part by part, in the same memory, which caches hold.
//!
//! Bad at: devices with memory of their own.

use super::batch::{DeviceBatch, Order};
use super::deferred::Deferred;
use super::rows::Rows;
use super::{Buffer, DeviceContext};
use crate::error::Result;
use crate::parallel::{self, rays_in_caches};
use crate::ray_order::SortRoom;
use crate::shared::{Hit, TraceRay};
use crate::tracer::{RayStream, TraceJob, TraceResult, take_in_pieces};
use std::ops::Range;

/// The memory of a part, which a tracer keeps from one batch to the next.
pub(super) struct Place {
    rays: Buffer<TraceRay>,
    hits: Buffer<Hit>,
    deferred: Deferred,
    /// Of the part before.
    rows: Rows,
    sort_room: SortRoom,
}

impl Place {
    /// Room for the parts of `stream`.
    pub fn new(context: &DeviceContext, defers: bool, stream: &RayStream) -> Result<Place> {
        let rays = rays_of_part(stream);
        Ok(Place {
            rays: Buffer::empty(context, "rays", rays)?,
            hits: Buffer::empty(context, "hits", rays)?,
            deferred: Deferred::new(context, defers, rays)?,
            rows: Rows::default(),
            sort_room: SortRoom::default(),
        })
    }

    pub fn has_room_for(&self, stream: &RayStream) -> bool {
        rays_of_part(stream) <= self.rays.len()
    }

    /// Traces all rays of `stream`, in an order of each part; `trace` traces the first rays of a batch, which are those
    /// of the stream, in seconds of device time.
    pub fn run(
        &mut self,
        context: &DeviceContext,
        stream: &RayStream,
        order: &Order,
        mut trace: impl FnMut(&DeviceBatch, Range<usize>) -> Result<f64>,
    ) -> Result<TraceResult> {
        let Place { rays, hits, deferred, rows, sort_room } = self;
        let before = deferred.resolved();
        let (mut kernel_s, mut sort_s) = (0.0, None);
        for first in (0..stream.count).step_by(rays_of_part(stream)) {
            let part = first..stream.count.min(first + rays_of_part(stream));
            let sorted = rays.in_place(part.len(), |made| {
                parallel::each(made.chunks_mut(RayStream::PIECE).enumerate(), |(piece, made)| {
                    (stream.make)(first + piece * RayStream::PIECE, made);
                });
                let any_hit = stream.any_hit;
                let job = TraceJob { rays: made, next_directions: None, extreme: &[], any_hit, repeat: 1 };
                let sorted = order.of(&job, sort_room)?;
                match &sorted {
                    Some(sorted) => *sort_s.get_or_insert(0.0) += sorted.sort_s,
                    None => *rows = rows.find_after(job.rays),
                }
                Ok(sorted)
            })??;
            let batch = DeviceBatch::new(context, (rays, hits, deferred), sorted.as_ref(), || *rows)?;
            kernel_s += trace(&batch, part.clone())?;
            hits.in_place(part.len(), |hits| take_in_pieces(stream.take, first, hits))?;
        }
        let second_pass = deferred.resolved().map(|all| all - before.unwrap_or(0));
        Ok(TraceResult { kernel_s: vec![kernel_s], sort_s, second_pass, ..TraceResult::default() })
    }
}

fn rays_of_part(stream: &RayStream) -> usize {
    stream.count.clamp(1, rays_in_caches())
}
