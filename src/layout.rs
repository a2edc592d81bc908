//! `device_struct!` and `device_const!`: the only places where a struct or a constant shared with the kernels is
//! defined.
//!
//! The first macro emits the `#[repr(C)]` Rust struct, the OpenCL `typedef` and a table of field offsets from one
//! definition. `cl/shared/types.cl` is generated from these typedefs, and `tests/device/kernels.rs` compares the
//! offsets with those that a probe kernel reports from the device in use. Allowed field types: `f32`, `u32`, [`Float4`]
//! and [`Int4`] (see [`DeviceField`]).
//!
//! The second one emits Rust constants and a table of them, from which `cl/shared/constants.cl` is generated. Allowed
//! types: `f32`, `u32`, `i32`, `usize` and `glam::Vec3` (see [`DeviceValue`]).

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
    /// Lines of its documentation.
    pub doc: &'static [&'static str],
}

/// A shared struct, described.
#[derive(Debug, Clone, Copy)]
pub struct StructLayout {
    /// Name, the same in Rust and OpenCL.
    pub name: &'static str,
    /// Size on the host, bytes.
    pub size_bytes: usize,
    /// Lines of its documentation.
    pub doc: &'static [&'static str],
    /// Its fields in order.
    pub fields: &'static [Field],
}

impl StructLayout {
    /// The struct as an OpenCL C `typedef`, with the first paragraph of its documentation and all of its fields'.
    pub fn cl_typedef(&self) -> String {
        let paragraph: Vec<_> = self.doc.iter().copied().take_while(|line| !line.is_empty()).collect();
        let mut text = comment_above("", &paragraph.concat()) + "typedef struct {\n";
        for field in self.fields {
            text += &commented(&format!("    {} {};", field.cl_type, field.name), &field.doc.concat());
        }
        text + &format!("}} {};\n", self.name)
    }
}

/// Columns of the generated files.
const COLUMNS: usize = 120;

/// A line of code with a comment: behind it, or above it where there is no room.
fn commented(code: &str, comment: &str) -> String {
    let line = format!("{code} // {}\n", comment.trim());
    if line.trim_end().chars().count() <= COLUMNS {
        return line;
    }
    let indent = &code[..code.len() - code.trim_start().len()];
    format!("{}{code}\n", comment_above(indent, comment))
}

/// A comment on lines of its own.
fn comment_above(indent: &str, comment: &str) -> String {
    let (mut text, mut line) = (String::new(), format!("{indent}//"));
    for word in comment.split_whitespace() {
        if line.chars().count() + 1 + word.chars().count() > COLUMNS {
            text += &format!("{line}\n");
            line = format!("{indent}//");
        }
        line += &format!(" {word}");
    }
    text + &line + "\n"
}

/// Defines a struct that host and kernels share. See the [module](self).
macro_rules! device_struct {
    (
        $(#[doc = $doc:literal])+
        pub struct $name:ident { $($(#[doc = $field_doc:literal])+ pub $field:ident: $kind:ty,)+ }
    ) => {
        $(#[doc = $doc])+
        #[repr(C)]
        #[derive(Debug, Clone, Copy, PartialEq, Default, bytemuck::Pod, bytemuck::Zeroable)]
        pub struct $name { $($(#[doc = $field_doc])+ pub $field: $kind,)+ }

        impl $name {
            /// Name, size and fields, as the kernels must see them.
            pub const LAYOUT: $crate::layout::StructLayout = $crate::layout::StructLayout {
                name: stringify!($name),
                size_bytes: std::mem::size_of::<$name>(),
                doc: &[$($doc),+],
                fields: &[$($crate::layout::Field {
                    name: stringify!($field),
                    cl_type: <$kind as $crate::layout::DeviceField>::CL_NAME,
                    offset_bytes: std::mem::offset_of!($name, $field),
                    doc: &[$($field_doc),+],
                }),+],
            };
        }
    };
}
pub(crate) use device_struct;

/// A type of constants that kernels have, too.
pub trait DeviceValue {
    /// The value as a literal of OpenCL C, exactly.
    fn cl_literal(self) -> String;
}

impl DeviceValue for u32 {
    fn cl_literal(self) -> String {
        format!("{self}u")
    }
}
impl DeviceValue for usize {
    fn cl_literal(self) -> String {
        u32::try_from(self).expect("numbers of the kernels have 32 bits").cl_literal()
    }
}
impl DeviceValue for i32 {
    fn cl_literal(self) -> String {
        self.to_string()
    }
}
impl DeviceValue for f32 {
    /// A hexadecimal floating constant, `0x1.8p-3f`: no compiler rounds it. The number is finite.
    fn cl_literal(self) -> String {
        assert!(self.is_finite(), "kernels have INFINITY and NAN for {self}");
        if self == 0.0 {
            return format!("{self:?}f");
        }
        // Every float32 is a normal number of f64: 52 bits of fraction, of which the last ones are 0.
        let bits = f64::from(self.abs()).to_bits();
        let exponent = (bits >> 52) as i32 - 1023;
        let digits = format!("{:013x}", bits & ((1 << 52) - 1));
        let digits = digits.trim_end_matches('0');
        let sign = if self < 0.0 { "-" } else { "" };
        let point = if digits.is_empty() { "" } else { "." };
        format!("{sign}0x1{point}{digits}p{exponent}f")
    }
}
impl DeviceValue for glam::Vec3 {
    fn cl_literal(self) -> String {
        format!("(float3)({})", self.to_array().map(f32::cl_literal).join(", "))
    }
}

/// A constant that host and kernels share.
#[derive(Debug, Clone, Copy)]
pub struct Constant {
    /// Name, the same in Rust and OpenCL.
    pub name: &'static str,
    /// Its value as a literal of OpenCL C.
    pub cl_literal: fn() -> String,
    /// Lines of its documentation.
    pub doc: &'static [&'static str],
}

/// Constants of one subject.
#[derive(Debug, Clone, Copy)]
pub struct ConstantGroup {
    /// Lines of its documentation.
    pub doc: &'static [&'static str],
    /// Those in it.
    pub constants: &'static [Constant],
}

impl ConstantGroup {
    /// The group as definitions of OpenCL C, each with the first sentence of its documentation.
    pub fn cl_definitions(&self) -> String {
        let mut text = comment_above("", &self.doc.concat());
        for constant in self.constants {
            let doc = constant.doc.concat();
            let sentence = doc.split_once(". ").map_or(doc.trim_end_matches('.'), |(first, _)| first);
            let sentence = sentence.replace("[`", "`").replace("`]", "`");
            let literal = (constant.cl_literal)();
            let literal = if literal.starts_with('-') { format!("({literal})") } else { literal };
            text += &commented(&format!("#define {} {literal}", constant.name), &sentence);
        }
        text
    }
}

/// Defines constants that host and kernels share, and a table of them. See the [module](self).
macro_rules! device_const {
    (
        $(#[doc = $group_doc:literal])+ pub group $group:ident;
        $($(#[doc = $doc:literal])+ pub const $name:ident: $kind:ty = $value:expr;)+
    ) => {
        $($(#[doc = $doc])+ pub const $name: $kind = $value;)+

        $(#[doc = $group_doc])+
        pub const $group: $crate::layout::ConstantGroup = $crate::layout::ConstantGroup {
            doc: &[$($group_doc),+],
            constants: &[$($crate::layout::Constant {
                name: stringify!($name),
                cl_literal: || $crate::layout::DeviceValue::cl_literal($name),
                doc: &[$($doc),+],
            }),+],
        };
    };
}
pub(crate) use device_const;

#[cfg(test)]
mod tests {
    use super::{COLUMNS, DeviceValue, commented};

    #[test]
    fn a_comment_stands_behind_code_where_there_is_room() {
        let code = "    uint a;";
        let room = COLUMNS - "    uint a; // ".len();
        assert_eq!(commented(code, &"b".repeat(room)), format!("{code} // {}\n", "b".repeat(room)));
        let words = format!("{} c d", "b".repeat(room));
        assert_eq!(commented(code, &words), format!("    // {words}\n{code}\n"));
        let words = ["b".repeat(COLUMNS - "    // ".len()), "c".to_owned()];
        assert_eq!(commented(code, &words.join(" ")), format!("    // {}\n    // c\n{code}\n", words[0]));
    }

    #[test]
    fn literals_are_exact() {
        for (number, literal) in [
            (0.0, "0.0f"),
            (-0.0, "-0.0f"),
            (1.0, "0x1p0f"),
            (-3.1, "-0x1.8cccccp1f"),
            (1.0 / 16_777_216.0, "0x1p-24f"),
            (1.0 + f32::EPSILON, "0x1.000002p0f"),
            (f32::MAX, "0x1.fffffep127f"),
            (f32::from_bits(1), "0x1p-149f"),
            (f32::from_bits(3), "0x1.8p-148f"),
        ] {
            assert_eq!(number.cl_literal(), literal);
        }
        assert_eq!(7usize.cl_literal(), "7u");
        assert_eq!((-7).cl_literal(), "-7");
        assert_eq!(glam::Vec3::new(1.0, -0.5, 0.0).cl_literal(), "(float3)(0x1p0f, -0x1p-1f, 0.0f)");
    }
}
