//! The model part: objects, colours and build items, as they stand in the XML.

use super::xml::{find, float, has_path, name_of, optional_whole, text, whole};
use crate::scene::text::quote;
use crate::scene::unused::Unused;
use crate::scene::{MaterialId, NO_INDEX, Triangle, paint};
use glam::{DAffine3, DMat3, DVec3, Vec3};
use quick_xml::NsReader;
use quick_xml::events::{BytesStart, Event};
use quick_xml::name::{Namespace, ResolveResult};
use std::collections::HashMap;
use std::io::BufRead;

/// The extension of which colour groups are read, textures not.
const MATERIALS: &str = "http://schemas.microsoft.com/3dmanufacturing/material/2015/02";

/// How deep elements may stand in each other; real models have some ten.
const MAX_DEPTH: usize = 64;

/// The elements that hold nothing to be seen, and are read over without a word.
const SILENT: [&str; 9] =
    ["model", "resources", "build", "metadata", "metadatagroup", "mesh", "vertices", "triangles", "components"];

type Read<T> = Result<T, String>;

/// Whose an element is.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Space {
    /// The format's own: that of the outermost element.
    Core,
    /// Of [`MATERIALS`].
    Materials,
    /// Of another extension, whose elements mean something else whatever their names.
    Other,
}

impl Space {
    fn of(space: &str, core: &str) -> Space {
        match space {
            _ if space == core => Space::Core,
            MATERIALS => Space::Materials,
            _ => Space::Other,
        }
    }
}

/// An object somewhere: a build item or a component.
pub(super) struct Item {
    /// Its number in the list of objects.
    pub object: usize,
    pub transform: DAffine3,
}

pub(super) enum Shape {
    Mesh {
        positions: Vec<Vec3>,
        /// Their materials are paints.
        triangles: Vec<Triangle>,
    },
    Components(Vec<Item>),
}

pub(super) struct Object {
    /// As the file has it.
    pub id: u32,
    pub shape: Shape,
}

/// A model.
pub(super) struct Model {
    pub objects: Vec<Object>,
    pub build: Vec<Item>,
    /// Whether a triangle has corners of different colours.
    pub blended: bool,
    pub unused: Unused,
    /// Of each object its number, by its identifier.
    numbers: HashMap<u32, usize>,
    /// The colours of each group, by its identifier.
    groups: HashMap<u32, Vec<[u8; 3]>>,
    /// The group that is being read.
    group: u32,
    /// Group and colour of the object's triangles that have none of their own.
    default: Option<(u32, u32)>,
}

impl Model {
    /// Reads a model; what is wrong, if anything.
    pub fn read(source: impl BufRead) -> Read<Model> {
        let mut model = Model {
            objects: Vec::new(),
            build: Vec::new(),
            blended: false,
            unused: Unused::default(),
            numbers: HashMap::new(),
            groups: HashMap::new(),
            group: 0,
            default: None,
        };
        let mut reader = NsReader::from_reader(source);
        let (mut buffer, mut depth) = (Vec::new(), 0usize);
        // That of the format, by whatever name: files of its first drafts have others.
        let mut core = None;
        loop {
            buffer.clear();
            let event = reader.read_resolved_event_into(&mut buffer);
            let (space, event) = event.map_err(|e| format!("not valid XML: {}", quote(e.to_string().as_bytes())))?;
            let space = match space {
                ResolveResult::Bound(Namespace(space)) => space,
                ResolveResult::Unbound => "",
                ResolveResult::Unknown(prefix) => {
                    return Err(format!("has elements of the prefix '{}', of no namespace", quote(prefix.as_bytes())));
                }
            };
            match event {
                Event::Start(element) => {
                    depth += 1;
                    if depth > MAX_DEPTH {
                        return Err(format!("has elements more than {MAX_DEPTH} deep in each other"));
                    }
                    let space = Space::of(space, core.get_or_insert_with(|| space.to_owned()));
                    model.element(&element, space, depth)?;
                }
                Event::Empty(element) => {
                    let space = Space::of(space, core.get_or_insert_with(|| space.to_owned()));
                    model.element(&element, space, depth + 1)?;
                }
                Event::End(_) => depth = depth.saturating_sub(1),
                Event::Eof if depth > 0 => return Err("is cut short".into()),
                Event::Eof => return Ok(model),
                _ => {}
            }
        }
    }

    fn element(&mut self, element: &BytesStart, space: Space, depth: usize) -> Read<()> {
        let name = element.local_name();
        if depth == 1 {
            return match name.as_ref() {
                "model" => check_required(element),
                _ => Err(format!("is no model: it begins with '{}'", name_of(element))),
            };
        }
        match (space, name.as_ref()) {
            (Space::Core, "object") => self.begin_object(element),
            (Space::Core, "vertex") => self.vertex(element),
            (Space::Core, "triangle") => self.triangle(element),
            (Space::Core, "component") => self.component(element),
            (Space::Core, "item") => {
                let item = self.item(element)?;
                self.build.push(item);
                Ok(())
            }
            (Space::Core, "basematerials") | (Space::Materials, "colorgroup") => {
                self.group = whole(element, "id")?;
                self.groups.insert(self.group, Vec::new());
                Ok(())
            }
            (Space::Core, "base") => self.colour(element, "displaycolor"),
            (Space::Materials, "color") => self.colour(element, "color"),
            (space, other) => {
                if space != Space::Core || !SILENT.contains(&other) {
                    self.unused.note(name_of(element));
                }
                Ok(())
            }
        }
    }

    fn begin_object(&mut self, element: &BytesStart) -> Read<()> {
        let id = whole(element, "id")?;
        if self.numbers.insert(id, self.objects.len()).is_some() {
            return Err(format!("has two objects {id}"));
        }
        let group = optional_whole(element, "pid")?;
        let index = optional_whole(element, "pindex")?.unwrap_or(0);
        self.default = group.map(|group| (group, index));
        self.objects.push(Object { id, shape: Shape::Mesh { positions: Vec::new(), triangles: Vec::new() } });
        Ok(())
    }

    fn vertex(&mut self, element: &BytesStart) -> Read<()> {
        let position = Vec3::new(float(element, "x")?, float(element, "y")?, float(element, "z")?);
        match self.objects.last_mut().map(|object| &mut object.shape) {
            Some(Shape::Mesh { positions, .. }) if positions.len() < NO_INDEX as usize => {
                positions.push(position);
                Ok(())
            }
            _ => Err("has a vertex outside of a mesh".into()),
        }
    }

    fn triangle(&mut self, element: &BytesStart) -> Read<()> {
        let corners = [whole(element, "v1")?, whole(element, "v2")?, whole(element, "v3")?];
        let material = self.paint(element)?;
        let Some(Object { id, shape: Shape::Mesh { positions, triangles } }) = self.objects.last_mut() else {
            return Err("has a triangle outside of a mesh".into());
        };
        if let Some(vertex) = corners.iter().find(|&&corner| corner as usize >= positions.len()) {
            let (number, count) = (triangles.len(), positions.len());
            return Err(format!("triangle {number} of object {id} names vertex {vertex}, but there are {count}"));
        }
        triangles.push(Triangle { positions: corners, normals: [NO_INDEX; 3], uvs: [NO_INDEX; 3], material });
        Ok(())
    }

    /// The paint of a triangle: its own colours, else the object's.
    fn paint(&mut self, element: &BytesStart) -> Read<MaterialId> {
        let group = optional_whole(element, "pid")?.or(self.default.map(|(group, _)| group));
        let first = optional_whole(element, "p1")?;
        let Some(group) = group else { return Ok(paint::PLAIN) };
        // Of a group that is no list of colours, such as one of textures, nothing is used.
        let Some(colours) = self.groups.get(&group) else { return Ok(paint::PLAIN) };
        let Some(first) = first.or(self.default.map(|(_, index)| index)) else { return Ok(paint::PLAIN) };
        let second = optional_whole(element, "p2")?.unwrap_or(first);
        let third = optional_whole(element, "p3")?.unwrap_or(first);
        let colour = |index: u32| {
            let found = colours.get(index as usize).copied();
            found.ok_or_else(|| format!("a triangle has colour {index} of group {group}, which has {}", colours.len()))
        };
        let corners = [colour(first)?, colour(second)?, colour(third)?];
        self.blended |= corners[1..].iter().any(|colour| *colour != corners[0]);
        Ok(paint::coloured(paint::mean(corners)))
    }

    fn component(&mut self, element: &BytesStart) -> Read<()> {
        let item = self.item(element)?;
        let last = self.objects.len().wrapping_sub(1);
        let Some(object) = self.objects.last_mut() else { return Err("has a component outside of an object".into()) };
        if item.object == last {
            return Err(format!("object {} has itself as a component", object.id));
        }
        match &mut object.shape {
            Shape::Components(parts) => parts.push(item),
            Shape::Mesh { positions, .. } if positions.is_empty() => object.shape = Shape::Components(vec![item]),
            Shape::Mesh { .. } => return Err(format!("object {} has a mesh and components", object.id)),
        }
        Ok(())
    }

    /// A build item or a component; its object stands before it.
    fn item(&self, element: &BytesStart) -> Read<Item> {
        if has_path(element) {
            return Err("has an object in another part (production extension), which is not supported".into());
        }
        let id = whole(element, "objectid")?;
        let object = self.numbers.get(&id).copied();
        let object = object.ok_or_else(|| format!("names object {id}, which is not defined before that"))?;
        let transform = text(element, "transform").map_or(Ok(DAffine3::IDENTITY), |text| transform(&text))?;
        Ok(Item { object, transform })
    }

    fn colour(&mut self, element: &BytesStart, name: &str) -> Read<()> {
        let value = text(element, name).ok_or_else(|| format!("a colour has no '{name}'"))?;
        let digits = value.trim().strip_prefix('#').filter(|digits| matches!(digits.len(), 6 | 8));
        let parsed = digits.filter(|digits| digits.is_ascii()).and_then(|digits| {
            let bits = u32::from_str_radix(digits, 16).ok()?;
            // An alpha stands behind the colour.
            Some(if digits.len() == 8 { bits.to_be_bytes() } else { (bits << 8 | 0xff).to_be_bytes() })
        });
        let [red, green, blue, alpha] =
            parsed.ok_or_else(|| format!("'{}' is no colour like #rrggbb", quote(value.as_bytes())))?;
        if alpha != u8::MAX {
            self.unused.note("transparency of colours");
        }
        if let Some(group) = self.groups.get_mut(&self.group) {
            group.push([red, green, blue]);
        }
        Ok(())
    }
}

/// Refuses what the model requires and is not known.
fn check_required(model: &BytesStart) -> Read<()> {
    let required = text(model, "requiredextensions").unwrap_or_default();
    for prefix in required.split_whitespace() {
        let key = format!("xmlns:{prefix}");
        let space = find(model, |name| name.as_ref() == key);
        if space.as_deref() != Some(MATERIALS) {
            let space = quote(space.as_deref().unwrap_or("no namespace").as_bytes());
            let prefix = quote(prefix.as_bytes());
            return Err(format!(
                "requires the extension '{prefix}' ({space}), which is not supported; save it without"
            ));
        }
    }
    Ok(())
}

/// Twelve numbers: of each of x, y and z where a unit of it goes, then an offset.
fn transform(text: &str) -> Read<DAffine3> {
    let numbers: Option<Vec<f64>> = text.split_whitespace().map(|word| word.parse().ok()).collect();
    let Some(m) = numbers.and_then(|numbers| <[f64; 12]>::try_from(numbers).ok()) else {
        return Err(format!("'{}' is no transform of 12 numbers", quote(text.as_bytes())));
    };
    let column = |first: usize| DVec3::new(m[first], m[first + 1], m[first + 2]);
    Ok(DAffine3::from_mat3_translation(DMat3::from_cols(column(0), column(3), column(6)), column(9)))
}
