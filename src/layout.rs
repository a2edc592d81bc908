//! `device_struct!`: the only place where a struct shared with the kernels is defined.
//!
//! The macro emits the `#[repr(C)]` Rust struct, the OpenCL `typedef` and a table of field offsets from one definition.
//! `cl/shared/types.cl` is generated from these typedefs, and `tests/device/layout.rs` compares the offsets with those that a probe
//! kernel reports from the device in use. Allowed field types: `f32`, `u32`, [`Float4`] and [`Int4`] (see [`DeviceField`]).

use bytemuck::{Pod, Zeroable};

/// OpenCL's `float4`.
#[repr(C, align(16))]
#[derive(Debug, Clone, Copy, PartialEq, Default, Pod, Zeroable)]
pub struct Float4 {
    /// First component.
    pub x: f32,
    /// Second component.
    pub y: f32,
    /// Third component.
    pub z: f32,
    /// Fourth component.
    pub w: f32,
}

impl Float4 {
    /// A vector of the three components of `v` and `w`.
    pub fn new(v: glam::Vec3, w: f32) -> Self {
        Float4 { x: v.x, y: v.y, z: v.z, w }
    }

    /// The first three components.
    pub fn xyz(self) -> glam::Vec3 {
        glam::Vec3::new(self.x, self.y, self.z)
    }
}

/// OpenCL's `int4`: whole numbers and bit patterns.
#[repr(C, align(16))]
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Pod, Zeroable)]
pub struct Int4 {
    /// First component.
    pub x: i32,
    /// Second component.
    pub y: i32,
    /// Third component.
    pub z: i32,
    /// Fourth component.
    pub w: i32,
}

/// A type that has the same size and alignment in Rust and in OpenCL C.
pub trait DeviceField: Pod {
    /// The type's name in OpenCL C.
    const CL_NAME: &'static str;
}

impl DeviceField for f32 {
    const CL_NAME: &'static str = "float";
}
impl DeviceField for u32 {
    const CL_NAME: &'static str = "uint";
}
impl DeviceField for Float4 {
    const CL_NAME: &'static str = "float4";
}
impl DeviceField for Int4 {
    const CL_NAME: &'static str = "int4";
}

/// One field of a shared struct.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Field {
    /// Name, the same in Rust and OpenCL.
    pub name: &'static str,
    /// Type in OpenCL.
    pub cl_type: &'static str,
    /// Offset on the host, bytes.
    pub offset_bytes: usize,
    /// First line of its documentation.
    pub doc: &'static str,
}

/// A shared struct, described.
#[derive(Debug, Clone, Copy)]
pub struct StructLayout {
    /// Name, the same in Rust and OpenCL.
    pub name: &'static str,
    /// Size on the host, bytes.
    pub size_bytes: usize,
    /// First line of its documentation.
    pub doc: &'static str,
    /// Its fields in order.
    pub fields: &'static [Field],
}

impl StructLayout {
    /// The struct as an OpenCL C `typedef`.
    pub fn cl_typedef(&self) -> String {
        let mut text = format!("//{}\ntypedef struct {{\n", self.doc);
        for field in self.fields {
            text += &format!("    {} {}; //{}\n", field.cl_type, field.name, field.doc);
        }
        text + &format!("}} {};\n", self.name)
    }
}

/// Defines a struct that host and kernels share. See the [module](self).
macro_rules! device_struct {
    ($(#[doc = $doc:literal])+ pub struct $name:ident { $($(#[doc = $field_doc:literal])+ pub $field:ident: $kind:ty,)+ }) => {
        $(#[doc = $doc])+
        #[repr(C)]
        #[derive(Debug, Clone, Copy, PartialEq, Default, bytemuck::Pod, bytemuck::Zeroable)]
        pub struct $name { $($(#[doc = $field_doc])+ pub $field: $kind,)+ }

        impl $name {
            /// Name, size and fields, as the kernels must see them.
            pub const LAYOUT: $crate::layout::StructLayout = $crate::layout::StructLayout {
                name: stringify!($name),
                size_bytes: std::mem::size_of::<$name>(),
                doc: [$($doc),+][0],
                fields: &[$($crate::layout::Field {
                    name: stringify!($field),
                    cl_type: <$kind as $crate::layout::DeviceField>::CL_NAME,
                    offset_bytes: std::mem::offset_of!($name, $field),
                    doc: [$($field_doc),+][0],
                }),+],
            };
        }
    };
}
pub(crate) use device_struct;
