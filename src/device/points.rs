//! Triangles that may be the nearest ones of points, on a device.

use super::definitions::stack_step;
use super::launch::{Arguments, FIRST_ITEMS, FIRST_ITEMS_GPU, LaunchPlan, Shape, launch};
use super::passes::Passes;
use super::scene::{Array, DeviceScene};
use super::{Buffer, CompileOptions, DeviceContext, DeviceKind, Kernel, ProgramSource};
use crate::bounds::MOST_CANDIDATES;
use crate::error::Result;
use crate::layout::Float4;
use crate::options::{StructureKind, TraceOptions};
use crate::pack::{PointScene, SceneBuffers};
use crate::shared::KdNode;
use crate::tracer::{Candidates, CandidatesJob, Progress};
use std::sync::Arc;

/// The kernel, and the scene that it was last asked for.
pub(super) struct PointProgram {
    kernel: Kernel,
    made_for: Hierarchy,
    scene: Option<DevicePointScene>,
    plan: LaunchPlan,
}

/// What kernels of points are compiled for.
#[derive(Clone, Copy, PartialEq)]
struct Hierarchy {
    is_wide: bool,
    stack_entries: u32,
}

impl Hierarchy {
    /// With so many entries that nearly every scene has the same kernel.
    fn new(is_wide: bool, stack_entries: u32) -> Hierarchy {
        let stack_entries = match is_wide {
            true => stack_entries.next_multiple_of(stack_step(StructureKind::Bvh8)),
            false => TraceOptions::MAX_DEPTH + 1,
        };
        Hierarchy { is_wide, stack_entries }
    }
}

/// A scene on the device.
struct DevicePointScene {
    scene: Arc<PointScene>,
    nodes: Buffer<KdNode>,
    references: Buffer<u32>,
    triangles: Buffer<Float4>,
}

impl DevicePointScene {
    /// Sends what the device does not have, for rays, as kernels of points read it.
    fn upload(context: &DeviceContext, scene: &Arc<PointScene>, of_rays: Option<&DeviceScene>) -> Result<Self> {
        let of_rays = of_rays.filter(|_| scene.is_shared());
        let uploaded = DevicePointScene {
            nodes: match of_rays.map(|of_rays| &of_rays.nodes) {
                Some(Array::Buffer(nodes)) => nodes.share(),
                _ => Buffer::from_slice(context, "nodes for points", scene.nodes())?,
            },
            references: match of_rays.map(|of_rays| &of_rays.references) {
                Some(Array::Buffer(references)) => references.share(),
                _ => Buffer::from_slice(context, "references for points", scene.references())?,
            },
            triangles: match of_rays.and_then(|of_rays| of_rays.triangles_of_points(scene.is_wide())) {
                Some(triangles) => triangles.share(),
                None => Buffer::from_slice(context, "triangles for points", scene.triangles())?,
            },
            scene: scene.clone(),
        };
        context.finish()?;
        Ok(uploaded)
    }
}

impl PointProgram {
    /// For the points of a scene that rays have packed, as far as that tells what they go through.
    pub fn new(context: &DeviceContext, passes: &mut Passes, buffers: &SceneBuffers) -> Result<Self> {
        let is_wide = PointScene::is_wide_for(buffers, context.info().kind == DeviceKind::Cpu);
        PointProgram::of(context, passes, Hierarchy::new(is_wide, buffers.stack_entries))
    }

    fn of(context: &DeviceContext, passes: &mut Passes, made_for: Hierarchy) -> Result<Self> {
        let options = CompileOptions::new().define("STACK_SIZE", made_for.stack_entries);
        let program = passes.build(context, &ProgramSource::closest_point(made_for.is_wide), &options)?;
        let is_gpu = context.info().kind == DeviceKind::Gpu;
        let plan = LaunchPlan::on(context, if is_gpu { FIRST_ITEMS_GPU } else { FIRST_ITEMS });
        Ok(PointProgram { kernel: program.kernel("list_candidates")?, made_for, scene: None, plan })
    }

    /// Finds the candidates of a job; `work_group` items at a time. `of_rays`: the arrays that rays go through, if the
    /// job is about the same scene.
    pub fn run(
        &mut self,
        context: &DeviceContext,
        passes: &mut Passes,
        of_rays: Option<&DeviceScene>,
        job: &CandidatesJob,
        work_group: usize,
        progress: Progress,
    ) -> Result<Candidates> {
        let made_for = Hierarchy::new(job.scene.is_wide(), job.scene.stack_entries());
        if made_for != self.made_for {
            *self = PointProgram::of(context, passes, made_for)?;
        }
        let scene = match self.scene.take().filter(|known| Arc::ptr_eq(&known.scene, job.scene)) {
            Some(known) => known,
            None => DevicePointScene::upload(context, job.scene, of_rays)?,
        };
        let scene = self.scene.insert(scene);
        let total = job.points.len();
        let points = Buffer::from_slice(context, "points", job.points)?;
        let counts = Buffer::<u32>::empty(context, "numbers of candidates", total)?;
        let listed = Buffer::<u32>::empty(context, "candidates", total * MOST_CANDIDATES as usize)?;
        let arguments = Arguments::of(&mut self.kernel).set(&scene.nodes)?.set(&scene.references)?;
        arguments.set(&scene.triangles)?.set(&points)?.set(&counts)?.set(&listed)?;
        let mut done = 0;
        let shape = Shape { items: 0..total, work_group, items_of_one: 1, workers: None };
        let kernel_s = launch(&mut self.kernel, &mut self.plan, shape, |items| {
            done += items;
            progress(done as f64 / total as f64);
        })?;
        Ok(Candidates { counts: counts.read()?, listed: listed.read()?, kernel_s })
    }
}
