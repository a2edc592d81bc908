//! Triangles that may be the nearest ones of points, on a device.

use super::launch::{Arguments, FIRST_ITEMS, FIRST_ITEMS_GPU, LaunchPlan, Shape, launch};
use super::passes::Passes;
use super::scene::{Array, DeviceScene};
use super::{Buffer, CompileOptions, DeviceContext, DeviceKind, Kernel, ProgramSource};
use crate::bounds::MOST_CANDIDATES;
use crate::error::Result;
use crate::layout::Float4;
use crate::options::TraceOptions;
use crate::pack::PointScene;
use crate::shared::KdNode;
use crate::tracer::{Candidates, CandidatesJob, Progress};
use std::sync::Arc;

/// The kernel, and the scene that it was last asked for.
pub(super) struct PointProgram {
    kernel: Kernel,
    scene: Option<DevicePointScene>,
    plan: LaunchPlan,
}

/// A scene on the device.
struct DevicePointScene {
    scene: Arc<PointScene>,
    nodes: Buffer<KdNode>,
    references: Buffer<u32>,
    vertices: Buffer<Float4>,
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
            vertices: match of_rays.and_then(DeviceScene::indexed_vertices) {
                Some(vertices) => vertices.share(),
                None => Buffer::from_slice(context, "vertices for points", scene.all_vertices())?,
            },
            scene: scene.clone(),
        };
        context.finish()?;
        Ok(uploaded)
    }
}

impl PointProgram {
    pub fn new(context: &DeviceContext, passes: &mut Passes) -> Result<Self> {
        let options = CompileOptions::new().define("STACK_SIZE", TraceOptions::MAX_DEPTH + 1);
        let program = passes.build(context, &ProgramSource::closest_point(), &options)?;
        let is_gpu = context.info().kind == DeviceKind::Gpu;
        let plan = LaunchPlan::on(context, if is_gpu { FIRST_ITEMS_GPU } else { FIRST_ITEMS });
        Ok(PointProgram { kernel: program.kernel("list_candidates")?, scene: None, plan })
    }

    /// Finds the candidates of a job; `work_group` items at a time. `of_rays`: the arrays that rays go through, if the
    /// job is about the same scene.
    pub fn run(
        &mut self,
        context: &DeviceContext,
        of_rays: Option<&DeviceScene>,
        job: &CandidatesJob,
        work_group: usize,
        progress: Progress,
    ) -> Result<Candidates> {
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
        arguments.set(&scene.vertices)?.set(&points)?.set(&counts)?.set(&listed)?;
        let mut done = 0;
        let shape = Shape { items: 0..total, work_group, items_of_one: 1, workers: None };
        let kernel_s = launch(&mut self.kernel, &mut self.plan, shape, |items| {
            done += items;
            progress(done as f64 / total as f64);
        })?;
        Ok(Candidates { counts: counts.read()?, listed: listed.read()?, kernel_s })
    }
}
