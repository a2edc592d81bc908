//! The scene's arrays on the device, in the kind of memory that was asked for, and the definitions that tell the
//! kernels (`cl/memory/geometry.cl`) where they are.

use super::launch::Arguments;
use super::{Buffer, CompileOptions, DeviceContext, IMAGE_WIDTH, Image, ImageShape, Kernel, KernelArg};
use crate::error::{Error, Result};
use crate::layout::Float4;
use crate::options::{Layout, Memory, StructureKind, TraceOptions, TriangleOrder};
use crate::pack::{CONSTANT_BYTES, CONSTANT_NODES, SceneBuffers};
use crate::shared::{KdNode, Light, Material, SceneParams, TextureInfo};
use bytemuck::Pod;
use std::borrow::Cow;

/// An array that traversal reads.
pub(super) enum Array<T: Pod> {
    Buffer(Buffer<T>),
    Image(Image),
}

impl<T: Pod> Array<T> {
    fn new(context: &DeviceContext, what: &str, data: &[T], memory: Memory) -> Result<Self> {
        Ok(match memory {
            Memory::Global | Memory::Constant => Array::Buffer(Buffer::from_slice(context, what, data)?),
            Memory::BufferImage => Array::Image(Image::from_slice(context, what, data, ImageShape::Buffer)?),
            Memory::Image2d => Array::Image(Image::from_slice(context, what, data, ImageShape::Rows)?),
        })
    }
}

impl<'a, T: Pod> From<&'a Array<T>> for KernelArg<'a> {
    fn from(array: &'a Array<T>) -> Self {
        match array {
            Array::Buffer(buffer) => buffer.into(),
            Array::Image(image) => image.into(),
        }
    }
}

/// The scene on a device.
pub(super) struct DeviceScene {
    pub nodes: Array<KdNode>,
    pub references: Array<u32>,
    pub vertices: Array<Float4>,
    pub bounds: Array<Float4>,
    pub transforms: Array<Float4>,
    pub constant_nodes: Option<Buffer<KdNode>>,
    pub surface_vertices: Option<Buffer<Float4>>,
    /// Whether `vertices` are those of triangles in their order, and nothing else.
    has_plain_triangles: bool,
    pub params: Buffer<SceneParams>,
    pub shading: Buffer<u32>,
    pub materials: Buffer<Material>,
    pub lights: Buffer<Light>,
    pub textures: Buffer<TextureInfo>,
    pub texels: Buffer<u32>,
    pub srgb_to_linear: Buffer<f32>,
}

impl DeviceScene {
    /// Copies everything to the device.
    pub fn upload(context: &DeviceContext, buffers: &SceneBuffers, options: &TraceOptions) -> Result<Self> {
        let arranged = buffers.arrange(options);
        let memory = options.arrays.memory;
        let info = context.info();
        if memory == Memory::Constant && info.constant_memory_bytes < CONSTANT_BYTES as u64 {
            let message = format!(
                "device '{}' has {} bytes of constant memory, {CONSTANT_BYTES} are needed; take `memory = global`",
                info.name, info.constant_memory_bytes
            );
            return Err(Error::NoDevice(message));
        }
        let constant_nodes = match memory {
            Memory::Constant => Some(Buffer::from_slice(context, "nodes in constant memory", arranged.constant_nodes)?),
            _ => None,
        };
        let surface_vertices = match options.arrays.triangles {
            TriangleOrder::LeafOrder => Some(Buffer::from_slice(context, "vertices", arranged.surface_vertices)?),
            TriangleOrder::Indexed => None,
        };
        let scene = DeviceScene {
            nodes: Array::new(context, "nodes", &buffers.nodes, memory)?,
            references: Array::new(context, "references", &buffers.references, memory)?,
            vertices: Array::new(context, "vertices", &arranged.vertices, memory)?,
            bounds: Array::new(context, "bounds", &buffers.bounds, memory)?,
            transforms: Array::new(context, "triangle transforms", &arranged.transforms, memory)?,
            constant_nodes,
            surface_vertices,
            has_plain_triangles: matches!(arranged.vertices, Cow::Borrowed(_)),
            params: Buffer::from_slice(context, "scene parameters", &[buffers.params])?,
            shading: Buffer::from_slice(context, "shading data", &arranged.shading)?,
            materials: Buffer::from_slice(context, "materials", &buffers.materials)?,
            lights: Buffer::from_slice(context, "lights", &buffers.lights)?,
            textures: Buffer::from_slice(context, "textures", &buffers.textures)?,
            texels: Buffer::from_slice(context, "texels", &buffers.texels)?,
            srgb_to_linear: Buffer::from_slice(context, "sRGB table", &buffers.srgb_to_linear)?,
        };
        context.finish()?;
        Ok(scene)
    }

    /// What [`PointScene::triangles`](crate::pack::PointScene::triangles) of the same structure are, if they are there
    /// in a buffer.
    pub fn triangles_of_points(&self, are_wide: bool) -> Option<&Buffer<Float4>> {
        match (&self.surface_vertices, &self.vertices, &self.bounds) {
            (_, _, Array::Buffer(packets)) if are_wide => Some(packets),
            (Some(vertices), _, _) if !are_wide => Some(vertices),
            (None, Array::Buffer(vertices), _) if !are_wide && self.has_plain_triangles => Some(vertices),
            _ => None,
        }
    }

    /// Sets what every tracing kernel's arguments begin with: `GEOMETRY_ARGUMENTS` of `cl/memory/geometry.cl`.
    pub fn geometry_arguments<'k>(&self, kernel: &'k mut Kernel) -> Result<Arguments<'k>> {
        let mut arguments = Arguments::of(kernel)
            .set(&self.nodes)?
            .set(&self.references)?
            .set(&self.vertices)?
            .set(&self.bounds)?
            .set(&self.transforms)?;
        if let Some(nodes) = &self.constant_nodes {
            arguments = arguments.set(nodes)?;
        }
        if let Some(vertices) = &self.surface_vertices {
            arguments = arguments.set(vertices)?;
        }
        arguments.set(&self.params)
    }

    /// Sets what every shading kernel's arguments begin with: `SCENE_ARGUMENTS` of `cl/shade/scene.cl`.
    pub fn scene_arguments<'k>(&self, kernel: &'k mut Kernel) -> Result<Arguments<'k>> {
        self.geometry_arguments(kernel)?
            .set(&self.shading)?
            .set(&self.materials)?
            .set(&self.lights)?
            .set(&self.textures)?
            .set(&self.texels)?
            .set(&self.srgb_to_linear)
    }

    /// Adds the definitions for kernels that read scenes with these options.
    pub fn define(mut compile: CompileOptions, options: &TraceOptions) -> CompileOptions {
        if options.arrays.layout == Layout::Whole {
            compile = compile.define("WHOLE_TRIANGLES", 1);
        }
        if options.arrays.triangles == TriangleOrder::LeafOrder {
            compile = compile.define("LEAF_ORDER", 1);
        }
        if options.kind() == StructureKind::Instances {
            compile = compile.define("INSTANCES", 1);
        }
        if options.counters {
            compile = compile.define("COUNT_WORK", 1);
        }
        match options.arrays.memory {
            Memory::Global | Memory::Constant => compile,
            Memory::BufferImage => compile.define("MEMORY_BUFFER_IMAGE", 1),
            Memory::Image2d => compile.define("MEMORY_IMAGE2D", 1).define("IMAGE_WIDTH", format!("{IMAGE_WIDTH}u")),
        }
    }

    /// Adds those for what of this scene is in constant memory, if that is asked for.
    pub fn define_constant(
        mut compile: CompileOptions,
        buffers: &SceneBuffers,
        options: &TraceOptions,
    ) -> CompileOptions {
        if options.arrays.memory != Memory::Constant {
            return compile;
        }
        let arranged = buffers.arrange(options);
        let all = arranged.constant_nodes.len() == buffers.nodes.len();
        compile = compile.define("CONSTANT_NODES", if all { "ALL_NODES".into() } else { format!("{CONSTANT_NODES}u") });
        if arranged.constant_references {
            compile = compile.define("CONSTANT_REFERENCES", 1);
        }
        if arranged.constant_vertices {
            compile = compile.define("CONSTANT_VERTICES", 1);
        }
        compile
    }
}
