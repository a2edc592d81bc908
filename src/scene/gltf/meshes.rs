//! Meshes: primitives as triangles, each mesh where the nodes put it.
//!
//! A mesh in one place becomes triangles there. Meshes of the same numbers, whatever they are called, in several places
//! are one object with instances; of one primitive they may differ in their materials.

use super::Source;
use super::accessors::{Accessors, Numbers};
use super::materials::{Coordinates, Look, Looks, Unlit};
use super::nodes::{Hierarchy, Placed};
use crate::error::Result;
use crate::scene::mesh::Corner;
use crate::scene::reading::check_memory;
use crate::scene::unused::Unused;
use crate::scene::{Builder, MaterialId, NO_INDEX, Triangle};
use ::gltf::json::accessor::Type;
use ::gltf::json::mesh::{Mode, Primitive, Semantic};
use ::gltf::json::validation::Checked;
use ::gltf::json::{Accessor, Index};
use glam::{DAffine3, Vec2, Vec3, Vec4};
use std::collections::HashMap;
use std::collections::hash_map::Entry;

/// What a triangle takes in memory while it is read and once it is in the scene: its corners and, at worst, three
/// vertices with all they may have, here in f32 and in the builder's f64.
const TRIANGLE_BYTES: u64 =
    (size_of::<Triangle>() + 100) as u64 + 3 * (2 * size_of::<Vec3>() + size_of::<Vec2>() + 64) as u64;

/// What makes the triangles of a primitive: accessors by their content, see [`Accessors::first_alike`].
#[derive(Debug, Clone, PartialEq, Eq, Hash)]
struct Shape {
    positions: usize,
    normals: Option<usize>,
    /// With what becomes of them, as bits.
    uvs: Option<(usize, [u64; 6])>,
    /// Where vertices have several.
    colours: Option<usize>,
    indices: Option<usize>,
    mode: u8,
}

/// A primitive that has triangles.
struct Part<'a> {
    primitive: &'a Primitive,
    mode: Mode,
    shape: Shape,
    look: Look,
    uvs: Option<(Index<Accessor>, Coordinates)>,
}

/// Adds all meshes of the hierarchy.
pub(super) fn add<'a>(
    source: &'a Source<'a>,
    hierarchy: &Hierarchy,
    looks: &mut Looks<'a>,
    builder: &mut Builder,
    unused: &mut Unused,
) -> Result<()> {
    let reader = Reader { source, accessors: Accessors::new(source) };
    choose_unlit(source, hierarchy, looks, builder);
    let mut parts: HashMap<usize, Vec<Part>> = HashMap::new();
    for placed in &hierarchy.meshes {
        if let Entry::Vacant(new) = parts.entry(placed.number) {
            new.insert(reader.parts(placed.number, looks, builder, unused)?);
        }
    }
    let groups = groups(hierarchy, &parts);
    reader.check_memory(&groups, &parts)?;
    for group in groups {
        reader.add_group(&group, &parts, looks, builder, unused)?;
        if let Some(fault) = builder.take_fault() {
            return Err(source.fault(format!("mesh {} cannot be placed: {fault}", group[0].number)));
        }
    }
    Ok(())
}

/// Where all surfaces are lit by nothing, ambient light shows their textures.
fn choose_unlit(source: &Source, hierarchy: &Hierarchy, looks: &mut Looks, builder: &mut Builder) {
    let meshes = hierarchy.meshes.iter().filter_map(|placed| source.root.meshes.get(placed.number));
    let mut primitives = meshes.flat_map(|mesh| &mesh.primitives).peekable();
    if primitives.peek().is_some() && primitives.all(|p| looks.is_unlit(p.material.map(|index| index.value()))) {
        looks.unlit = Unlit::ByAmbientLight;
        builder.ambient(Vec3::ONE);
    }
}

/// The places of equal meshes, in the order in which they are first met.
fn groups(hierarchy: &Hierarchy, parts: &HashMap<usize, Vec<Part>>) -> Vec<Vec<Placed>> {
    let mut numbers = HashMap::new();
    let mut groups: Vec<Vec<Placed>> = Vec::new();
    for placed in &hierarchy.meshes {
        let parts = &parts[&placed.number];
        if parts.is_empty() {
            continue;
        }
        // An instance may have one material, for all of it.
        let has_several = parts.len() > 1 || parts[0].shape.colours.is_some();
        let materials: Vec<_> = parts.iter().filter(|_| has_several).map(|part| part.look.material).collect();
        let shapes: Vec<_> = parts.iter().map(|part| &part.shape).collect();
        let group = *numbers.entry((shapes, materials)).or_insert(groups.len());
        if group == groups.len() {
            groups.push(Vec::new());
        }
        groups[group].push(*placed);
    }
    groups
}

struct Reader<'a> {
    source: &'a Source<'a>,
    accessors: Accessors<'a>,
}

impl<'a> Reader<'a> {
    /// The primitives of a mesh that have triangles to be seen.
    fn parts(
        &self,
        number: usize,
        looks: &mut Looks<'a>,
        builder: &mut Builder,
        unused: &mut Unused,
    ) -> Result<Vec<Part<'a>>> {
        let mesh = self.source.root.meshes.get(number);
        let mesh = mesh.ok_or_else(|| self.source.fault(format!("there is no mesh {number}, though a node has it")))?;
        let mut parts = Vec::new();
        for primitive in &mesh.primitives {
            parts.extend(self.part(primitive, looks, builder, unused)?);
        }
        Ok(parts)
    }

    fn part(
        &self,
        primitive: &'a Primitive,
        looks: &mut Looks<'a>,
        builder: &mut Builder,
        unused: &mut Unused,
    ) -> Result<Option<Part<'a>>> {
        let Checked::Valid(mode) = primitive.mode else {
            unused.note("primitives of no known mode");
            return Ok(None);
        };
        match mode {
            Mode::Points => unused.note("points"),
            Mode::Lines | Mode::LineLoop | Mode::LineStrip => unused.note("lines"),
            Mode::Triangles | Mode::TriangleStrip | Mode::TriangleFan => {}
        }
        let is_flat = matches!(mode, Mode::Triangles | Mode::TriangleStrip | Mode::TriangleFan);
        let attribute = |semantic| primitive.attributes.get(&Checked::Valid(semantic)).copied();
        let Some(positions) = attribute(Semantic::Positions).filter(|_| is_flat) else {
            unused.add("primitives without positions", usize::from(is_flat));
            return Ok(None);
        };
        unused.add("morph targets", usize::from(primitive.targets.as_ref().is_some_and(|all| !all.is_empty())));
        let colours = attribute(Semantic::Colors(0));
        let tint = self.tint(colours)?;
        let material = primitive.material.map(|index| index.value());
        if let Some(number) = material.filter(|&number| number >= self.source.root.materials.len()) {
            return Err(self.source.fault(format!("there is no material {number}, though a primitive has it")));
        }
        let look = looks.of(material, tint.unwrap_or(Vec4::ONE), builder, unused);
        if !look.is_seen {
            unused.note("surfaces that their alpha mask hides");
            return Ok(None);
        }
        let uvs = look.uvs.and_then(|uvs| Some((attribute(Semantic::TexCoords(uvs.set))?, uvs)));
        unused.add("textures without coordinates", usize::from(look.uvs.is_some() && uvs.is_none()));
        let normals = attribute(Semantic::Normals);
        let shape = Shape {
            positions: self.accessors.first_alike(positions)?,
            normals: normals.map(|index| self.accessors.first_alike(index)).transpose()?,
            uvs: uvs.map(|(index, uvs)| Ok((self.accessors.first_alike(index)?, uvs.bits()))).transpose()?,
            colours: colours.filter(|_| tint.is_none()).map(|index| self.accessors.first_alike(index)).transpose()?,
            indices: primitive.indices.map(|index| self.accessors.first_alike(index)).transpose()?,
            mode: mode as u8,
        };
        Ok(Some(Part { primitive, mode, shape, look, uvs }))
    }

    /// The one colour of all vertices; none where they have several, or nobody looks.
    fn tint(&self, colours: Option<Index<Accessor>>) -> Result<Option<Vec4>> {
        let Some(index) = colours else { return Ok(Some(Vec4::ONE)) };
        let colours = Colours::new(&self.accessors, index)?;
        let mut all = (0..colours.count()).map(|i| colours.at(i));
        let Some(first) = all.next() else { return Ok(Some(Vec4::ONE)) };
        if !self.accessors.may_look_at((colours.count() * size_of::<Vec4>()) as u64) {
            return Ok(None);
        }
        Ok(all.all(|colour| colour == first).then_some(first))
    }

    /// The mean colour of each triangle's corners, of which there are `vertices` in all; and whether they differ.
    fn triangle_colours(
        &self,
        index: Index<Accessor>,
        triangles: &[[u32; 3]],
        vertices: usize,
    ) -> Result<Vec<(Vec4, bool)>> {
        let colours = Colours::new(&self.accessors, index)?;
        self.check_count("colours", colours.count(), vertices)?;
        let mean = |corners: &[u32; 3]| {
            let [a, b, c] = corners.map(|corner| colours.at(corner as usize));
            ((a + b + c) / 3.0, a != b || a != c)
        };
        Ok(triangles.iter().map(mean).collect())
    }

    /// How many corners the triangles of a part have.
    fn corners(&self, part: &Part) -> Result<u64> {
        let index = part.primitive.indices.map_or(part.shape.positions, |index| index.value());
        Ok(self.accessors.kind(Index::new(index as u32))?.0)
    }

    /// Checks that there is memory for all triangles, before the first of them is read.
    fn check_memory(&self, groups: &[Vec<Placed>], parts: &HashMap<usize, Vec<Part>>) -> Result<()> {
        let mut triangles = 0u64;
        for group in groups {
            // Where a transform flattens them they are there once more.
            let copies = 1 + group.iter().filter(|placed| !placed.is_solid()).count() as u64;
            for part in &parts[&group[0].number] {
                let corners = self.corners(part)?;
                let of_part = if part.mode == Mode::Triangles { corners / 3 } else { corners };
                triangles = triangles.saturating_add(of_part.saturating_mul(copies));
            }
        }
        check_memory(self.source.path, triangles.saturating_mul(TRIANGLE_BYTES), &self.source.budget)
    }

    /// Adds equal meshes wherever they are.
    fn add_group(
        &self,
        group: &[Placed],
        parts: &HashMap<usize, Vec<Part>>,
        looks: &mut Looks<'a>,
        builder: &mut Builder,
        unused: &mut Unused,
    ) -> Result<()> {
        let own = &parts[&group[0].number];
        // Equal meshes of one primitive may differ in their materials.
        let material = |placed: &Placed| {
            let look = parts[&placed.number][0].look.material;
            (own.len() == 1 && look != own[0].look.material).then_some(look)
        };
        let (solid, flat): (Vec<&Placed>, Vec<&Placed>) = group.iter().partition(|placed| placed.is_solid());
        let (single, shared) = if solid.len() == 1 { (&solid[..], &[][..]) } else { (&[][..], &solid[..]) };
        let mut meshes: Vec<Mesh> = Vec::new();
        for part in own {
            meshes.extend(self.mesh(part, looks, builder, unused)?);
        }
        for placed in single {
            builder.push().multiply("node", placed.transform);
            meshes.iter().for_each(|mesh| mesh.add(builder, material(placed)));
            builder.pop();
        }
        for placed in flat {
            for mesh in &meshes {
                match mesh.flattened(placed.transform) {
                    Some(flat) => flat.add(builder, material(placed)),
                    None => _ = builder.fail("the transform moves a vertex out of float32's range"),
                }
            }
        }
        if shared.is_empty() {
            return Ok(());
        }
        builder.begin_object();
        meshes.iter().for_each(|mesh| mesh.add(builder, None));
        let object = builder.end_object();
        for placed in shared {
            builder.push().multiply("node", placed.transform).instance(object, material(placed)).pop();
        }
        Ok(())
    }

    /// The triangles of a part; none where it has too few vertices.
    fn mesh(
        &self,
        part: &Part,
        looks: &mut Looks<'a>,
        builder: &mut Builder,
        unused: &mut Unused,
    ) -> Result<Option<Mesh>> {
        let positions = self.accessors.numbers::<3>(Index::new(part.shape.positions as u32))?;
        let corners = self.corner_indices(part, positions.count)?;
        let mut triangles = triangles(part.mode, &corners);
        unused.add("indices that make no triangle", left_over(part.mode, corners.len()));
        drop(corners);
        let materials = match part.shape.colours {
            None => Materials::One(part.look.material),
            Some(colours) => {
                let colours = self.triangle_colours(Index::new(colours as u32), &triangles, positions.count)?;
                let number = part.primitive.material.map(|index| index.value());
                Materials::Each(looks.of_colours(number, &colours, builder))
            }
        };
        let used = number_anew(&mut triangles, positions.count);
        if triangles.is_empty() {
            return Ok(None);
        }
        let vector = |from: &Numbers<3>| used.iter().map(|&i| Vec3::from(from.at(i as usize))).collect::<Vec<_>>();
        let normals =
            part.shape.normals.map(|index| self.accessors.numbers::<3>(Index::new(index as u32))).transpose()?;
        if let Some(normals) = &normals {
            self.check_count("normals", normals.count, positions.count)?;
        }
        let uvs = self.uvs(part, &used, positions.count, unused)?;
        let (positions, normals) = (vector(&positions), normals.as_ref().map(vector));
        Ok(Some(Mesh { positions, normals, uvs, triangles, materials }))
    }

    fn check_count(&self, what: &str, count: usize, due: usize) -> Result<()> {
        if count >= due {
            return Ok(());
        }
        Err(self.source.fault(format!("a primitive has {count} {what} for {due} vertices")))
    }

    /// The vertices of the corners, all of which there are.
    fn corner_indices(&self, part: &Part, vertices: usize) -> Result<Vec<u32>> {
        let Some(index) = part.primitive.indices else { return Ok((0..vertices as u32).collect()) };
        let indices = self.accessors.wholes(index)?;
        let corners: Vec<u32> = (0..indices.count).map(|i| indices.at(i)).collect();
        match corners.iter().position(|&vertex| vertex as usize >= vertices) {
            None => Ok(corners),
            Some(i) => Err(self.source.fault(format!(
                "accessor {}: index {i} is {}, but there are {vertices} vertices",
                index.value(),
                corners[i]
            ))),
        }
    }

    /// The texture coordinates of the vertices in use; none without a texture.
    fn uvs(&self, part: &Part, used: &[u32], vertices: usize, unused: &mut Unused) -> Result<Vec<Vec2>> {
        let Some((index, coordinates)) = part.uvs else { return Ok(Vec::new()) };
        let numbers = self.accessors.numbers::<2>(index)?;
        self.check_count("texture coordinates", numbers.count, vertices)?;
        let mut leaves = false;
        let mut place = |&i: &u32| {
            let (uv, leaves_here) = coordinates.place(numbers.at(i as usize));
            leaves |= leaves_here;
            uv
        };
        let uvs = used.iter().map(&mut place).collect();
        unused.add("ends of textures (CLAMP_TO_EDGE): they repeat", usize::from(leaves));
        Ok(uvs)
    }
}

/// Colours of vertices, with alpha or without.
enum Colours<'a> {
    Opaque(Numbers<'a, 3>),
    Transparent(Numbers<'a, 4>),
}

impl<'a> Colours<'a> {
    fn new(accessors: &Accessors<'a>, index: Index<Accessor>) -> Result<Colours<'a>> {
        Ok(match accessors.kind(index)?.1 {
            Type::Vec4 => Colours::Transparent(accessors.numbers(index)?),
            _ => Colours::Opaque(accessors.numbers(index)?),
        })
    }

    fn count(&self) -> usize {
        match self {
            Colours::Opaque(colours) => colours.count,
            Colours::Transparent(colours) => colours.count,
        }
    }

    fn at(&self, vertex: usize) -> Vec4 {
        match self {
            Colours::Opaque(colours) => Vec3::from(colours.at(vertex)).extend(1.0),
            Colours::Transparent(colours) => colours.at(vertex).into(),
        }
    }
}

/// The triangles that `corners` make.
fn triangles(mode: Mode, corners: &[u32]) -> Vec<[u32; 3]> {
    match mode {
        Mode::TriangleStrip => {
            let turned = |(i, c): (usize, &[u32])| if i % 2 == 0 { [c[0], c[1], c[2]] } else { [c[1], c[0], c[2]] };
            let strip = corners.windows(3).enumerate().map(turned);
            // Writers join strips by triangles without area.
            strip.filter(|[a, b, c]| a != b && b != c && c != a).collect()
        }
        Mode::TriangleFan => match corners.split_first() {
            Some((&first, rest)) => rest.windows(2).map(|c| [first, c[0], c[1]]).collect(),
            None => Vec::new(),
        },
        _ => corners.chunks_exact(3).map(|c| [c[0], c[1], c[2]]).collect(),
    }
}

/// How many of so many corners make no triangle.
fn left_over(mode: Mode, corners: usize) -> usize {
    match mode {
        Mode::TriangleStrip | Mode::TriangleFan if corners >= 3 => 0,
        Mode::TriangleStrip | Mode::TriangleFan => corners,
        _ => corners % 3,
    }
}

/// Numbers the vertices of triangles from 0, in the order of their old numbers, and tells these.
fn number_anew(triangles: &mut [[u32; 3]], vertices: usize) -> Vec<u32> {
    let corners = 3 * triangles.len();
    if corners < vertices / 4 {
        // A small part of a large list: by search, not by a table.
        let mut used: Vec<u32> = triangles.as_flattened().to_vec();
        used.sort_unstable();
        used.dedup();
        for index in triangles.as_flattened_mut() {
            *index = used.partition_point(|&known| known < *index) as u32;
        }
        return used;
    }
    let mut numbers = vec![0u32; vertices];
    triangles.as_flattened().iter().for_each(|&index| numbers[index as usize] = 1);
    let used: Vec<u32> = (0..vertices as u32).filter(|&vertex| numbers[vertex as usize] == 1).collect();
    (0..).zip(&used).for_each(|(number, &vertex)| numbers[vertex as usize] = number);
    triangles.as_flattened_mut().iter_mut().for_each(|index| *index = numbers[*index as usize]);
    used
}

/// What triangles are made of.
#[derive(Clone)]
enum Materials {
    /// All of the same.
    One(MaterialId),
    /// Each of its own.
    Each(Vec<MaterialId>),
}

/// The triangles of a primitive in coordinates of their own.
struct Mesh {
    positions: Vec<Vec3>,
    normals: Option<Vec<Vec3>>,
    uvs: Vec<Vec2>,
    triangles: Vec<[u32; 3]>,
    materials: Materials,
}

impl Mesh {
    /// With a material for all of it, or with its own.
    fn add(&self, builder: &mut Builder, material: Option<MaterialId>) {
        let (has_normals, has_uvs) = (self.normals.is_some(), !self.uvs.is_empty());
        let corner = |position: u32| Corner {
            position,
            normal: if has_normals { position } else { NO_INDEX },
            uv: if has_uvs { position } else { NO_INDEX },
        };
        let mesh = crate::scene::mesh::Mesh {
            positions: self.positions.iter().map(|p| p.as_dvec3()).collect(),
            normals: self.normals.iter().flatten().map(|n| n.as_dvec3()).collect(),
            uvs: self.uvs.clone(),
            triangles: self.triangles.iter().map(|triangle| triangle.map(corner)).collect(),
        };
        builder.add_geometry(&mesh, |triangle| match (material, &self.materials) {
            (Some(material), _) | (None, &Materials::One(material)) => material,
            (None, Materials::Each(materials)) => materials[triangle],
        });
    }

    /// The mesh where a transform puts it that flattens space: its normals are those of the triangles. None where that
    /// is out of float32's range.
    fn flattened(&self, transform: DAffine3) -> Option<Mesh> {
        let place = |p: &Vec3| {
            let placed = transform.transform_point3(p.as_dvec3()).as_vec3();
            (placed.is_finite() || !p.is_finite()).then_some(placed)
        };
        let positions = self.positions.iter().map(place).collect::<Option<Vec<Vec3>>>()?;
        let (uvs, triangles) = (self.uvs.clone(), self.triangles.clone());
        Some(Mesh { positions, normals: None, uvs, triangles, materials: self.materials.clone() })
    }
}
