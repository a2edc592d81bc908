//! Accessors: numbers of every component type, packed or with a stride, normalised or not, with sparse ones in place of
//! others. Elements are read one by one where they are, so that many primitives may share a large accessor.

use super::Source;
use crate::error::{Error, Result};
use crate::scene::reading::check_memory;
use ::gltf::json::accessor::{ComponentType, Type};
use ::gltf::json::buffer::View;
use ::gltf::json::validation::{Checked, USize64};
use ::gltf::json::{Accessor, Index};
use std::cell::{Cell, RefCell};
use std::collections::HashMap;
use std::rc::Rc;

/// The most elements of an accessor that is in no buffer: all of them are zero but for the sparse ones.
const MAX_ZEROS: u64 = 1 << 22;

/// The most sparse elements of all accessors together: many may share the bytes that tell them, so that a small file
/// would take long.
const MAX_SPARSE: u64 = 1 << 26;

/// The most bytes that are looked at to find out what is alike: accessors of a small file may share a large buffer.
const MAX_LOOKED_AT: u64 = 1 << 32;

/// Bytes of a sparse element in a map, which is filled to seven eighths at the most, and to half of that when it has
/// just grown.
const SPARSE_BYTES: u64 = 2 * (2 * size_of::<u32>() as u64 + 1) * 8 / 7;

/// Elements in a view.
#[derive(Clone, Copy)]
struct Elements<'a> {
    bytes: &'a [u8],
    stride: usize,
    component: ComponentType,
}

impl<'a> Elements<'a> {
    /// The bytes of component `part` of element `element`; both were checked when the elements were found.
    fn component(&self, element: usize, part: usize) -> &'a [u8] {
        let size = self.component.size();
        let from = element * self.stride + part * size;
        self.bytes.get(from..from + size).unwrap_or(&[])
    }

    fn number(&self, element: usize, part: usize, normalized: bool) -> f32 {
        let bytes = self.component(element, part);
        let scaled = |value: f32, most: f32| if normalized { (value / most).max(-1.0) } else { value };
        match (self.component, bytes) {
            (ComponentType::I8, &[a]) => scaled(f32::from(a as i8), 127.0),
            (ComponentType::U8, &[a]) => scaled(f32::from(a), 255.0),
            (ComponentType::I16, &[a, b]) => scaled(f32::from(i16::from_le_bytes([a, b])), 32_767.0),
            (ComponentType::U16, &[a, b]) => scaled(f32::from(u16::from_le_bytes([a, b])), 65_535.0),
            (ComponentType::U32, &[a, b, c, d]) => u32::from_le_bytes([a, b, c, d]) as f32,
            (ComponentType::F32, &[a, b, c, d]) => f32::from_le_bytes([a, b, c, d]),
            _ => 0.0,
        }
    }

    fn whole(&self, element: usize) -> u32 {
        match *self.component(element, 0) {
            [a] => u32::from(a),
            [a, b] => u32::from(u16::from_le_bytes([a, b])),
            [a, b, c, d] => u32::from_le_bytes([a, b, c, d]),
            _ => 0,
        }
    }
}

/// Sparse elements, by the numbers of those in whose place they are.
type Replaced = Rc<HashMap<u32, u32>>;

/// An accessor of `N` numbers an element.
pub(super) struct Numbers<'a, const N: usize> {
    pub count: usize,
    normalized: bool,
    dense: Option<Elements<'a>>,
    sparse: Option<(Replaced, Elements<'a>)>,
}

impl<const N: usize> Numbers<'_, N> {
    /// Element `element`, which must be below the count.
    pub fn at(&self, element: usize) -> [f32; N] {
        let replaced = self.sparse.as_ref().and_then(|(places, values)| {
            let &value = places.get(&(element as u32))?;
            Some((*values, value as usize))
        });
        match replaced.or(self.dense.map(|dense| (dense, element))) {
            Some((elements, element)) => std::array::from_fn(|part| elements.number(element, part, self.normalized)),
            None => [0.0; N],
        }
    }
}

/// An accessor of whole numbers.
pub(super) struct Wholes<'a> {
    pub count: usize,
    dense: Elements<'a>,
    sparse: Option<(Replaced, Elements<'a>)>,
}

impl Wholes<'_> {
    pub fn at(&self, element: usize) -> u32 {
        let replaced = self.sparse.as_ref().and_then(|(places, values)| {
            let &value = places.get(&(element as u32))?;
            Some(values.whole(value as usize))
        });
        replaced.unwrap_or_else(|| self.dense.whole(element))
    }
}

/// Reads accessors. It keeps which elements are sparse, as primitives may share an accessor.
pub(super) struct Accessors<'a> {
    source: &'a Source<'a>,
    replaced: RefCell<HashMap<usize, Replaced>>,
    /// How many sparse elements there were so far.
    sparse: Cell<u64>,
    /// How many bytes were looked at so far to find out what is alike.
    looked_at: Cell<u64>,
    /// The first accessor of each content, and of each accessor that was asked for the first one like it.
    firsts: RefCell<HashMap<Content<'a>, usize>>,
    alike: RefCell<HashMap<usize, usize>>,
}

/// What makes packed accessors equal: count and type of the elements, component type, whether normalised, the bytes.
type Content<'a> = (u64, u8, u8, bool, &'a [u8]);

impl<'a> Accessors<'a> {
    pub fn new(source: &'a Source<'a>) -> Accessors<'a> {
        Accessors {
            source,
            replaced: RefCell::default(),
            sparse: Cell::default(),
            looked_at: Cell::default(),
            firsts: RefCell::default(),
            alike: RefCell::default(),
        }
    }

    /// How many elements accessor `index` says that it has, and of which type.
    pub fn kind(&self, index: Index<Accessor>) -> Result<(u64, Type)> {
        let accessor = self.find(index)?;
        let Checked::Valid(kind) = accessor.type_ else { return Err(self.fault(index, "is of no known type")) };
        Ok((accessor.count.0, kind))
    }

    /// The number of the first accessor that was asked for and has the same numbers as accessor `index`; of those that
    /// are sparse or interleaved, or come behind [`MAX_LOOKED_AT`] bytes, nobody looks whether they are the same.
    pub fn first_alike(&self, index: Index<Accessor>) -> Result<usize> {
        let known = self.alike.borrow().get(&index.value()).copied();
        match known {
            Some(first) => Ok(first),
            None => {
                let first = self.find_alike(index)?;
                self.alike.borrow_mut().insert(index.value(), first);
                Ok(first)
            }
        }
    }

    /// Whether there is time to look at so many bytes more, which are then counted, to find out what is alike.
    pub fn may_look_at(&self, bytes: u64) -> bool {
        let sum = self.looked_at.get().saturating_add(bytes);
        let may = sum <= MAX_LOOKED_AT;
        if may {
            self.looked_at.set(sum);
        }
        may
    }

    fn find_alike(&self, index: Index<Accessor>) -> Result<usize> {
        let accessor = self.find(index)?;
        let (count, kind) = self.kind(index)?;
        let component = self.component(index, accessor)?;
        let Some(view) = accessor.buffer_view.filter(|_| accessor.sparse.is_none()) else { return Ok(index.value()) };
        let elements = self.elements(index, view, accessor.byte_offset, count, (component, kind.multiplicity()))?;
        let size = kind.multiplicity() * component.size();
        let bytes = elements.bytes.get(..count as usize * size).filter(|_| elements.stride == size);
        let Some(bytes) = bytes.filter(|bytes| self.may_look_at(bytes.len() as u64)) else { return Ok(index.value()) };
        let content = (count, kind as u8, component as u8, accessor.normalized, bytes);
        Ok(*self.firsts.borrow_mut().entry(content).or_insert(index.value()))
    }

    /// Accessor `index` as vectors of `N` numbers.
    pub fn numbers<const N: usize>(&self, index: Index<Accessor>) -> Result<Numbers<'a, N>> {
        let accessor = self.find(index)?;
        let (_, kind) = self.kind(index)?;
        if kind.multiplicity() != N {
            return Err(self.fault(index, &format!("is of {kind:?}, but should have {N} numbers an element")));
        }
        let component = self.component(index, accessor)?;
        let dense = match accessor.buffer_view {
            Some(view) => Some(self.elements(index, view, accessor.byte_offset, accessor.count.0, (component, N))?),
            None if accessor.count.0 <= MAX_ZEROS => None,
            None => return Err(self.fault(index, "has too many elements for one without a bufferView")),
        };
        let count = accessor.count.0 as usize;
        Ok(Numbers { count, normalized: accessor.normalized, dense, sparse: self.sparse(index, (component, N))? })
    }

    /// Accessor `index` as indices.
    pub fn wholes(&self, index: Index<Accessor>) -> Result<Wholes<'a>> {
        let accessor = self.find(index)?;
        let component = self.component(index, accessor)?;
        let is_whole = matches!(component, ComponentType::U8 | ComponentType::U16 | ComponentType::U32);
        let (_, kind) = self.kind(index)?;
        if !is_whole || kind != Type::Scalar {
            return Err(self.fault(index, &format!("is of {component:?} {kind:?}, which are no indices")));
        }
        let Some(view) = accessor.buffer_view else {
            return Err(self.fault(index, "has indices, but no bufferView"));
        };
        let dense = self.elements(index, view, accessor.byte_offset, accessor.count.0, (component, 1))?;
        Ok(Wholes { count: accessor.count.0 as usize, dense, sparse: self.sparse(index, (component, 1))? })
    }

    fn find(&self, index: Index<Accessor>) -> Result<&'a Accessor> {
        let found = self.source.root.accessors.get(index.value());
        found.ok_or_else(|| self.fault(index, "is named, but there is none"))
    }

    fn fault(&self, index: Index<Accessor>, message: &str) -> Error {
        self.source.fault(format!("accessor {} {message}", index.value()))
    }

    fn component(&self, index: Index<Accessor>, accessor: &Accessor) -> Result<ComponentType> {
        match accessor.component_type {
            Checked::Valid(component) => Ok(component.0),
            Checked::Invalid => Err(self.fault(index, "has components of no known type")),
        }
    }

    /// `count` elements of so many components in a view, from `offset` on.
    fn elements(
        &self,
        index: Index<Accessor>,
        view: Index<View>,
        offset: Option<USize64>,
        count: u64,
        (component, components): (ComponentType, usize),
    ) -> Result<Elements<'a>> {
        let bytes = self.source.buffers.view(view)?;
        let offset = offset.map_or(0, |offset| offset.0);
        let element = components * component.size();
        let stride = self.source.buffers.stride(view).unwrap_or(element);
        if stride < element {
            let message = format!("has elements of {element} bytes, but its bufferView has one every {stride} bytes");
            return Err(self.fault(index, &message));
        }
        let before_last = count.saturating_sub(1).checked_mul(stride as u64);
        let needed = before_last.and_then(|bytes| bytes.checked_add(offset)?.checked_add(element as u64));
        if count > 0 && needed.is_none_or(|needed| needed > bytes.len() as u64) {
            let (view, size) = (view.value(), bytes.len());
            let message = format!("has {count} elements, which do not fit into the {size} bytes of bufferView {view}");
            return Err(self.fault(index, &message));
        }
        let bytes = usize::try_from(offset).ok().and_then(|offset| bytes.get(offset..)).unwrap_or(&[]);
        Ok(Elements { bytes, stride, component })
    }

    fn sparse(&self, index: Index<Accessor>, kind: (ComponentType, usize)) -> Result<Option<(Replaced, Elements<'a>)>> {
        let accessor = self.find(index)?;
        let Some(sparse) = &accessor.sparse else { return Ok(None) };
        let count = sparse.count.0;
        let values = self.elements(index, sparse.values.buffer_view, Some(sparse.values.byte_offset), count, kind)?;
        if let Some(known) = self.replaced.borrow().get(&index.value()) {
            return Ok(Some((Rc::clone(known), values)));
        }
        let Checked::Valid(component) = sparse.indices.component_type else {
            return Err(self.fault(index, "has sparse indices of no known type"));
        };
        let view = sparse.indices.buffer_view;
        let places = self.elements(index, view, Some(sparse.indices.byte_offset), count, (component.0, 1))?;
        self.check_sparse(count, accessor.count.0)?;
        let mut replaced = HashMap::new();
        for value in 0..count as u32 {
            let place = places.whole(value as usize);
            if u64::from(place) >= accessor.count.0 {
                let message = format!("has a sparse element {place}, but only {} elements", accessor.count.0);
                return Err(self.fault(index, &message));
            }
            replaced.insert(place, value);
        }
        let replaced = Rc::new(replaced);
        self.replaced.borrow_mut().insert(index.value(), Rc::clone(&replaced));
        Ok(Some((replaced, values)))
    }

    /// Checks that there is time and memory for `count` sparse elements more, in place of some of `all`.
    fn check_sparse(&self, count: u64, all: u64) -> Result<()> {
        let sum = self.sparse.get().saturating_add(count);
        if sum > MAX_SPARSE {
            return Err(self.source.fault(format!("has more than {MAX_SPARSE} sparse elements in its accessors")));
        }
        self.sparse.set(sum);
        check_memory(self.source.path, SPARSE_BYTES * count.min(all), &self.source.budget)
    }
}
