//! How the arrays are laid out for a device: copies in leaf order, whole triangles, and what goes to constant memory.
//! The twin reads the same numbers from [`SceneBuffers`] itself.

use super::SceneBuffers;
use crate::features::Features;
use crate::layout::Float4;
use crate::options::{KernelFeatures, Layout, Memory, TraceOptions, TriangleOrder};
use crate::shared::Feature;
use crate::shared::{KdNode, Shading};
use std::borrow::Cow;

impl Features {
    /// Those that kernels have for a scene that needs these.
    pub const fn in_kernels(self, choice: KernelFeatures) -> Features {
        match choice {
            KernelFeatures::Scene => self,
            KernelFeatures::All => Features::ALL,
        }
    }
}

/// What is put into constant memory altogether. Devices of the full profile have at least 64 KiB (OpenCL 1.2, table
/// 4.3); the rest is left to compilers, which keep literals and arguments there.
pub const CONSTANT_BYTES: usize = 48 << 10;

/// Nodes that fit into constant memory.
pub const CONSTANT_NODES: usize = CONSTANT_BYTES / size_of::<KdNode>();

/// The arrays of a scene as [`TraceOptions`] want them on a device.
#[derive(Debug)]
pub struct Arrangement<'a> {
    /// Three of each triangle or, in leaf order, of each reference; with whole triangles seven, the last four being its
    /// [`Shading`].
    pub vertices: Cow<'a, [Float4]>,
    /// Three of each triangle or reference, or empty.
    pub transforms: Cow<'a, [Float4]>,
    /// In leaf order: three of each triangle, for shading; else empty.
    pub surface_vertices: &'a [Float4],
    /// Words of one [`Shading`] of each triangle; or its material alone, where kernels read no more; or none with whole
    /// triangles, and where there is one material.
    pub shading: Cow<'a, [u32]>,
    /// The nodes that lie in constant memory: the first of all.
    pub constant_nodes: &'a [KdNode],
    /// Whether the references do.
    pub constant_references: bool,
    /// Whether the vertices do.
    pub constant_vertices: bool,
}

impl SceneBuffers {
    /// Lays the arrays out as `options` want them.
    pub fn arrange(&self, options: &TraceOptions) -> Arrangement<'_> {
        let copied = |records: &[Float4]| -> Cow<[Float4]> {
            let triangle = |&primitive: &u32| &records[3 * primitive as usize..][..3];
            self.references.iter().flat_map(triangle).copied().collect()
        };
        let leaf_order = options.arrays.triangles == TriangleOrder::LeafOrder;
        let whole = options.arrays.layout == Layout::Whole;
        let vertices = match (whole, leaf_order) {
            (true, _) => Cow::Owned(self.whole_triangles()),
            (_, true) => copied(&self.vertices),
            _ => Cow::Borrowed(&self.vertices[..]),
        };
        let transforms = match leaf_order && !self.transforms.is_empty() {
            true => copied(&self.transforms),
            false => Cow::Borrowed(&self.transforms[..]),
        };
        let mut left = if options.arrays.memory == Memory::Constant { CONSTANT_BYTES } else { 0 };
        let constant_nodes = &self.nodes[..self.nodes.len().min(left / size_of::<KdNode>())];
        left -= size_of_val(constant_nodes);
        // In turn: what does not fit leaves nothing to those behind it, so that few variants of the kernels exist.
        let mut fits = |bytes: usize| {
            let fits = bytes <= left;
            left = if fits { left - bytes } else { 0 };
            fits
        };
        let constant_references = constant_nodes.len() == self.nodes.len() && fits(size_of_val(&self.references[..]));
        let constant_vertices = constant_references && fits(size_of_val(&vertices[..]));
        Arrangement {
            vertices,
            transforms,
            surface_vertices: if leaf_order { &self.vertices } else { &[] },
            shading: if whole { Cow::Borrowed(&[]) } else { self.shading_words(options) },
            constant_nodes,
            constant_references,
            constant_vertices,
        }
    }

    /// What kernels read of the shading data.
    fn shading_words(&self, options: &TraceOptions) -> Cow<'_, [u32]> {
        let features = self.features.in_kernels(options.picture.features);
        match (features.need_shading_data(), features.has(Feature::SeveralMaterials)) {
            (true, _) => Cow::Borrowed(bytemuck::cast_slice(&self.shading)),
            (false, true) => self.shading.iter().map(|shading| shading.material).collect(),
            (false, false) => Cow::Borrowed(&[]),
        }
    }

    /// Vertices and shading data of each triangle, one behind the other.
    fn whole_triangles(&self) -> Vec<Float4> {
        let shading = |s: &Shading| {
            let rest = Float4 { x: s.v0, y: s.v1, z: s.v2, w: f32::from_bits(s.material) };
            [s.normal0_u0, s.normal1_u1, s.normal2_u2, rest]
        };
        let triangles = self.vertices.chunks_exact(3).zip(&self.shading);
        triangles.flat_map(|(vertices, s)| vertices.iter().copied().chain(shading(s))).collect()
    }

    /// Bytes of the arrays, as a device holds them with `options`.
    pub fn size_bytes(&self, options: &TraceOptions) -> usize {
        let arranged = self.arrange(options);
        size_of_val(&self.nodes[..])
            + size_of_val(&self.references[..])
            + size_of_val(&arranged.vertices[..])
            + size_of_val(arranged.surface_vertices)
            + size_of_val(&self.bounds[..])
            + size_of_val(&arranged.transforms[..])
            + size_of_val(&arranged.shading[..])
            + size_of_val(arranged.constant_nodes)
            + size_of_val(&self.materials[..])
            + size_of_val(&self.lights[..])
            + size_of_val(&self.textures[..])
            + size_of_val(&self.texels[..])
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::options::KernelFeatures;
    use crate::options::{ArrayOptions, PictureOptions};
    use crate::scene::{Builder, Material};

    fn sphere(fineness: u32, options: &TraceOptions) -> SceneBuffers {
        let mut builder = Builder::new();
        builder.material(Material::matt([0.5; 3].into()));
        builder.sphere(1.0, fineness);
        SceneBuffers::new(&builder.finish().unwrap(), options).unwrap()
    }

    #[test]
    fn triangles_have_the_shading_data_that_kernels_read() {
        let options = TraceOptions::DEFAULT;
        let words = |options: &TraceOptions, build: fn(&mut Builder)| {
            let mut builder = Builder::new();
            build(builder.material(Material::matt([0.5; 3].into())).cuboid([1.0; 3].into()));
            let buffers = SceneBuffers::new(&builder.finish().unwrap(), options).unwrap();
            let shading = buffers.arrange(options).shading.into_owned();
            (shading.len() as f32 / buffers.shading.len() as f32, shading.last().copied())
        };
        let two: fn(&mut Builder) = |builder| {
            builder.material(Material::matt([0.1; 3].into())).cuboid([2.0; 3].into());
        };
        assert_eq!(words(&options, |_| ()), (0.0, None));
        assert_eq!(words(&options, two), (1.0, Some(1)));
        let whole_words = (size_of::<Shading>() / size_of::<u32>()) as f32;
        assert_eq!(words(&options, |builder| _ = builder.sphere(1.0, 8)).0, whole_words);
        let all =
            TraceOptions { picture: PictureOptions { features: KernelFeatures::All, ..options.picture }, ..options };
        assert_eq!(words(&all, |_| ()).0, whole_words);
    }

    #[test]
    fn leaf_order_follows_the_references() {
        let options = TraceOptions {
            arrays: ArrayOptions { triangles: TriangleOrder::LeafOrder, ..ArrayOptions::DEFAULT },
            ..TraceOptions::DEFAULT
        };
        let buffers = sphere(16, &options);
        let arranged = buffers.arrange(&options);
        assert_eq!(arranged.vertices.len(), 3 * buffers.references.len());
        for (copy, &primitive) in arranged.vertices.chunks(3).zip(&buffers.references) {
            assert_eq!(copy, &buffers.vertices[3 * primitive as usize..][..3]);
        }
        assert_eq!(arranged.surface_vertices, buffers.vertices);
    }

    #[test]
    fn whole_triangles_keep_every_number() {
        let options = TraceOptions {
            arrays: ArrayOptions { layout: Layout::Whole, ..ArrayOptions::DEFAULT },
            ..TraceOptions::DEFAULT
        };
        let buffers = sphere(16, &options);
        let arranged = buffers.arrange(&options);
        assert!(arranged.shading.is_empty());
        for (i, whole) in arranged.vertices.chunks(7).enumerate() {
            assert_eq!(whole[..3], buffers.vertices[3 * i..3 * i + 3]);
            assert_eq!(bytemuck::cast_slice::<_, u8>(&whole[3..]), bytemuck::bytes_of(&buffers.shading[i]));
        }
    }

    #[test]
    fn constant_memory_gets_what_fits_in_turn() {
        let options = TraceOptions {
            arrays: ArrayOptions { memory: Memory::Constant, ..ArrayOptions::DEFAULT },
            ..TraceOptions::DEFAULT
        };
        let mut seen = [false; 3];
        for fineness in (4..40).step_by(4).chain([48, 96]) {
            let buffers = sphere(fineness, &options);
            let arranged = buffers.arrange(&options);
            let mut bytes = size_of_val(arranged.constant_nodes);
            bytes += if arranged.constant_references { size_of_val(&buffers.references[..]) } else { 0 };
            bytes += if arranged.constant_vertices { size_of_val(&arranged.vertices[..]) } else { 0 };
            assert!(bytes <= CONSTANT_BYTES, "{fineness}: {bytes} bytes");
            let parts = [arranged.constant_nodes.len() == buffers.nodes.len(), arranged.constant_references];
            assert!(!parts[1] || parts[0]);
            assert!(!arranged.constant_vertices || parts[1]);
            seen[usize::from(parts[0]) + usize::from(arranged.constant_vertices)] = true;
        }
        assert_eq!(seen, [true; 3], "too large, without and with vertices");
        let none = sphere(8, &TraceOptions::DEFAULT);
        assert!(none.arrange(&TraceOptions::DEFAULT).constant_nodes.is_empty());
    }
}
