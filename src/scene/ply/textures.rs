//! The textures that a PLY file names.

use crate::budget::MemoryBudget;
use crate::scene::text::{Warnings, quote};
use crate::scene::texture::{decode, find_inside};
use crate::scene::{Image, SourceFile, TextureId};
use std::collections::HashMap;
use std::path::{Path, PathBuf};

/// What the name of a texture follows in a comment; MeshLab's convention.
const TEXTURE_COMMENT: &str = "TextureFile ";

/// The names of textures in `comments`.
pub(super) fn named(comments: &[String]) -> Vec<&str> {
    comments.iter().filter_map(|comment| comment.strip_prefix(TEXTURE_COMMENT)).collect()
}

/// Loads the textures that `comments` of the PLY file `path` name: which of them each number of a face means, and the
/// textures.
pub(super) fn load_textures(
    path: &Path,
    comments: &[String],
    warnings: &mut Warnings,
    budget: &MemoryBudget,
) -> (Vec<Option<TextureId>>, Vec<Image>) {
    let folder = path.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."));
    let (mut numbers, mut textures) = (Vec::new(), Vec::new());
    let mut known: HashMap<PathBuf, Option<TextureId>> = HashMap::new();
    for name in named(comments) {
        let root = folder.canonicalize().map_err(|e| format!("cannot be opened: {e}"));
        let found = root.and_then(|root| find_inside(&root, &root, name)).and_then(|file| {
            if let Some(&id) = known.get(&file) {
                return Ok(id);
            }
            let decoded = decode(&file, name, budget);
            let id = decoded.is_ok().then_some(textures.len() as TextureId);
            known.insert(file, id);
            textures.push(decoded?);
            Ok(id)
        });
        numbers.push(found.unwrap_or_else(|reason| {
            warnings.add(path, None, format!("texture '{}' {reason}; it is left out", quote(name.as_bytes())));
            None
        }));
    }
    (numbers, textures)
}

/// The pictures that `comments` of the PLY file `path` name and that are there, whether faces use them or not.
pub(super) fn named_files(path: &Path, comments: &[String]) -> Vec<SourceFile> {
    let folder = path.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."));
    let Ok(root) = folder.canonicalize() else { return Vec::new() };
    let files = named(comments).into_iter().filter_map(|name| find_inside(&root, &root, name).ok());
    files.map(|file| SourceFile { path: file, role: format!("the texture that '{}' names", path.display()) }).collect()
}
