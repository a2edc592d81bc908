//! Textures: 8-bit sRGB pictures. Decoding is bounded in size, memory and kind.

/// Index of a texture in its scene.
pub type TextureId = u32;

/// A picture for a surface.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Texture {
    /// File it came from, for messages.
    pub name: String,
    /// Texels a row.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// `width * height` texels of R, G, B, A in 8-bit sRGB (A linear, not used), top row first.
    pub rgba: Vec<[u8; 4]>,
}

/// Reads the picture `name` in `folder` (stub).
pub(super) fn load_texture(_folder: &std::path::Path, _name: &str) -> std::result::Result<Texture, String> {
    Err("textures cannot be read yet".into())
}
