//! The hierarchy of nodes: which mesh, camera and light is where.

use super::Source;
use super::accessors::Accessors;
use crate::error::Result;
use crate::scene::Transform;
use crate::scene::reading::check_memory;
use crate::scene::unused::Unused;
use ::gltf::json::{Accessor, Index, Node};
use glam::{DAffine3, DMat4, DQuat, DVec3};

/// The extension that puts a mesh in many places by three accessors.
const INSTANCING: &str = "EXT_mesh_gpu_instancing";

/// Something, by its number, and where it is.
#[derive(Debug, Clone, Copy)]
pub(super) struct Placed {
    pub number: usize,
    /// From its coordinates to those of the world.
    pub transform: DAffine3,
}

impl Placed {
    /// Whether an instance can be there: none is where a transform flattens space.
    pub fn is_solid(&self) -> bool {
        Transform::new(self.transform).is_some()
    }
}

/// What is in the scene, in the order of the nodes.
#[derive(Debug, Default)]
pub(super) struct Hierarchy {
    pub meshes: Vec<Placed>,
    pub cameras: Vec<Placed>,
    pub lights: Vec<Placed>,
}

/// Follows the nodes of the scene that is shown, parents before children.
///
/// Without recursion, as a file may be deeper than the stack. A node with two parents, and so one in a cycle, is
/// refused.
pub(super) fn walk(source: &Source, unused: &mut Unused) -> Result<Hierarchy> {
    let nodes = &source.root.nodes;
    let accessors = Accessors::new(source);
    let mut seen = vec![false; nodes.len()];
    let mut found = Hierarchy::default();
    let mut waiting: Vec<(usize, DAffine3)> =
        roots(source)?.into_iter().rev().map(|root| (root, DAffine3::IDENTITY)).collect();
    while let Some((number, parent)) = waiting.pop() {
        let Some(node) = nodes.get(number) else {
            return Err(source.fault(format!("there is no node {number}, though one is named")));
        };
        if std::mem::replace(&mut seen[number], true) {
            return Err(source.fault(format!("node {number} has two parents or is its own ancestor; nodes are a tree")));
        }
        let transform = parent * local(node);
        if !transform.is_finite() {
            return Err(source.fault(format!("node {number} has a transform that is not finite")));
        }
        add(source, &accessors, node, transform, &mut found)?;
        unused.add("skins", usize::from(node.skin.is_some()));
        waiting.extend(node.children.iter().flatten().rev().map(|child| (child.value(), transform)));
    }
    Ok(found)
}

/// The nodes without a parent of the scene that is shown; of all nodes where there is no scene.
fn roots(source: &Source) -> Result<Vec<usize>> {
    let root = source.root;
    let shown = root.scene.map_or(0, |scene| scene.value());
    match root.scenes.get(shown) {
        Some(scene) => Ok(scene.nodes.iter().map(|node| node.value()).collect()),
        None if root.scene.is_some() => Err(source.fault(format!("there is no scene {shown}, which is the default"))),
        None => {
            let mut is_child = vec![false; root.nodes.len()];
            for child in root.nodes.iter().flat_map(|node| node.children.iter().flatten()) {
                if let Some(is_child) = is_child.get_mut(child.value()) {
                    *is_child = true;
                }
            }
            Ok((0..root.nodes.len()).filter(|&node| !is_child[node]).collect())
        }
    }
}

/// From a node's coordinates to those of its parent.
fn local(node: &Node) -> DAffine3 {
    if let Some(matrix) = node.matrix {
        return DAffine3::from_mat4(DMat4::from_cols_array(&matrix.map(f64::from)));
    }
    let vector = |v: [f32; 3]| DVec3::from(v.map(f64::from));
    placed(
        node.translation.map_or(DVec3::ZERO, vector),
        node.rotation.map_or([0.0, 0.0, 0.0, 1.0], |rotation| rotation.0),
        node.scale.map_or(DVec3::ONE, vector),
    )
}

/// Scales, then turns, then moves. A quaternion without length turns nothing.
fn placed(translation: DVec3, rotation: [f32; 4], scale: DVec3) -> DAffine3 {
    let rotation = DQuat::from_array(rotation.map(f64::from));
    let length = rotation.length();
    let rotation = if length > 0.0 { rotation * length.recip() } else { DQuat::IDENTITY };
    DAffine3::from_scale_rotation_translation(scale, rotation, translation)
}

/// Adds what `node` has to what was found.
fn add(source: &Source, accessors: &Accessors, node: &Node, transform: DAffine3, found: &mut Hierarchy) -> Result<()> {
    let at = |number: usize| Placed { number, transform };
    if let Some(mesh) = node.mesh {
        match copies(source, accessors, node)? {
            None => found.meshes.push(at(mesh.value())),
            Some(copies) => {
                let placed = |copy| Placed { number: mesh.value(), transform: transform * copy };
                found.meshes.extend(copies.into_iter().map(placed));
            }
        }
    }
    found.cameras.extend(node.camera.map(|camera| at(camera.value())));
    let light = node.extensions.as_ref().and_then(|all| all.khr_lights_punctual.as_ref());
    found.lights.extend(light.map(|light| at(light.light.value())));
    Ok(())
}

/// Where [`INSTANCING`] puts the mesh of `node`, in its coordinates; none without it.
fn copies(source: &Source, accessors: &Accessors, node: &Node) -> Result<Option<Vec<DAffine3>>> {
    let Some(extension) = node.extensions.as_ref().and_then(|all| all.others.get(INSTANCING)) else { return Ok(None) };
    let attribute = |name: &str| -> Result<Option<Index<Accessor>>> {
        let Some(value) = extension.get("attributes").and_then(|all| all.get(name)) else { return Ok(None) };
        let number = value.as_u64().and_then(|number| u32::try_from(number).ok());
        let wrong = || source.fault(format!("{INSTANCING}: {name} is no accessor"));
        number.map(|number| Some(Index::new(number))).ok_or_else(wrong)
    };
    let translations = attribute("TRANSLATION")?.map(|index| accessors.numbers::<3>(index)).transpose()?;
    let rotations = attribute("ROTATION")?.map(|index| accessors.numbers::<4>(index)).transpose()?;
    let scales = attribute("SCALE")?.map(|index| accessors.numbers::<3>(index)).transpose()?;
    let counts = [translations.as_ref().map(|n| n.count), rotations.as_ref().map(|n| n.count)];
    let counts: Vec<usize> = counts.into_iter().flatten().chain(scales.as_ref().map(|n| n.count)).collect();
    let Some(&count) = counts.first() else { return Ok(None) };
    if counts.iter().any(|&other| other != count) {
        return Err(
            source.fault(format!("{INSTANCING}: its attributes have {counts:?} elements; they must be as many"))
        );
    }
    check_memory(source.path, (count * (size_of::<DAffine3>() + size_of::<Placed>())) as u64, &source.budget)?;
    let vector = |v: [f32; 3]| DVec3::from(v.map(f64::from));
    let copy = |i: usize| {
        placed(
            translations.as_ref().map_or(DVec3::ZERO, |all| vector(all.at(i))),
            rotations.as_ref().map_or([0.0, 0.0, 0.0, 1.0], |all| all.at(i)),
            scales.as_ref().map_or(DVec3::ONE, |all| vector(all.at(i))),
        )
    };
    let copies: Vec<_> = (0..count).map(copy).collect();
    match copies.iter().position(|copy| !copy.is_finite()) {
        Some(i) => Err(source.fault(format!("{INSTANCING}: copy {i} has a transform that is not finite"))),
        None => Ok(Some(copies)),
    }
}
