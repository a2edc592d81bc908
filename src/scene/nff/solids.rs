//! Spheres, cones and cylinders of NFF files, broken into triangles.

use super::Reader;
use crate::error::{Error, Result};
use crate::scene::solids::DEFAULT_SEGMENTS;
use crate::scene::text::Warnings;
use crate::scene::words::Words;
use glam::{DAffine3, DMat3};
use std::path::Path;

/// The most triangles that the solids of a file are broken into: a line of ten bytes stands for thousands of them, and
/// these take 0.3 GB.
pub(super) const MAX_TRIANGLES: usize = 1 << 22;

/// The fewest segments around a solid that still looks round when it is shaded smoothly.
const MIN_SEGMENTS: u32 = 8;

/// As many segments for each solid of `text` as [`MAX_TRIANGLES`] for all of them allow.
pub(super) fn segments(path: &Path, text: &[u8], warnings: &mut Warnings) -> Result<u32> {
    let solids = Words::new(text).filter(|word| matches!(word.text, b"s" | b"c")).count();
    // A sphere of n segments has less than n² triangles, a cone 2 n.
    let segments = (MAX_TRIANGLES as f64 / solids.max(1) as f64).sqrt() as u32;
    if segments < MIN_SEGMENTS {
        let most = MAX_TRIANGLES / (MIN_SEGMENTS * MIN_SEGMENTS) as usize;
        let message = format!("has {solids} spheres, cones and cylinders; the most is {most}: split it");
        return Err(Error::input(path, None, message));
    }
    if segments < DEFAULT_SEGMENTS {
        let message = format!(
            "{solids} spheres, cones and cylinders are made of {segments} segments each, not {DEFAULT_SEGMENTS}, to \
             have no more than {MAX_TRIANGLES} triangles"
        );
        warnings.add(path, None, message);
    }
    Ok(segments.min(DEFAULT_SEGMENTS))
}

impl Reader<'_> {
    pub(super) fn read_sphere(&mut self, line: usize) -> Result<()> {
        let center = self.vector("the centre of a sphere")?;
        let radius = self.number("the radius of a sphere")?;
        if radius < 0.0 {
            self.inside_out.note(line);
        }
        if !(center.is_finite() && radius.is_finite() && radius != 0.0) {
            self.solids_without_size.note(line);
            return Ok(());
        }
        self.builder.push().translate(center).sphere(radius.abs(), self.segments).pop();
        Ok(())
    }

    pub(super) fn read_cone(&mut self, line: usize) -> Result<()> {
        let base = self.vector("the base of a cone")?;
        let base_radius = self.number("the radius of a cone's base")?;
        let apex = self.vector("the apex of a cone")?;
        let apex_radius = self.number("the radius of a cone's apex")?;
        if base_radius.min(apex_radius) < 0.0 {
            self.inside_out.note(line);
        }
        let along = apex.as_dvec3() - base.as_dvec3();
        let (height, widest) = (along.length() as f32, base_radius.abs().max(apex_radius.abs()));
        // A NaN fails every comparison, and max() forgets one of two.
        let sizes = [height, base_radius, apex_radius];
        if !(sizes.iter().all(|size| size.is_finite()) && height > 0.0 && widest > 0.0) {
            self.solids_without_size.note(line);
            return Ok(());
        }
        // The builder's frustum stands on the origin, its axis y.
        let up = along.normalize();
        let right = up.any_orthonormal_vector();
        let turn = DAffine3::from_mat3(DMat3::from_cols(right, up, right.cross(up)));
        let builder = self.builder.push().translate(base).multiply("cone", turn);
        builder.frustum(base_radius.abs(), apex_radius.abs(), height, self.segments, false).pop();
        Ok(())
    }
}
