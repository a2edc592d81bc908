//! The bytes of a file: its own, those that stand in its URIs, and those of files beside it.

use super::MAX_FILE_BYTES;
use crate::budget::MemoryBudget;
use crate::error::{Error, Result};
use crate::scene::SourceFile;
use crate::scene::reading::{check_memory, read_all};
use crate::scene::text::quote;
use crate::scene::texture::find_inside;
use ::gltf::json::buffer::View;
use ::gltf::json::{Index, Root};
use base64::Engine;
use base64::alphabet::STANDARD;
use base64::engine::{DecodePaddingMode, GeneralPurpose, GeneralPurposeConfig};
use percent_encoding::{percent_decode, percent_decode_str};
use std::borrow::Cow;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// How many files a file may name: each costs some system calls.
const MAX_FILES: usize = 65_536;

/// Base64 as `data:` URIs have it, with or without its padding.
const BASE64: GeneralPurpose = GeneralPurpose::new(
    &STANDARD,
    GeneralPurposeConfig::new()
        .with_decode_padding_mode(DecodePaddingMode::Indifferent)
        .with_decode_allow_trailing_bits(true),
);

/// What a URI leads to.
pub(super) enum Target {
    /// Bytes that stand in it.
    Bytes(Vec<u8>),
    /// A regular file in the folder of the glTF file, or below.
    File(PathBuf),
}

/// What `uri`, named by the file at `path`, leads to; one clause without its name if that is nothing to be opened.
pub(super) fn follow(path: &Path, uri: &str, budget: &MemoryBudget) -> std::result::Result<Target, String> {
    let scheme = uri.split_once(':').map(|(scheme, _)| scheme).filter(|scheme| is_scheme(scheme));
    match scheme {
        None => find_file(path, uri).map(Target::File),
        Some(scheme) if scheme.eq_ignore_ascii_case("data") => {
            check_memory(path, uri.len() as u64, budget).map_err(|e| e.to_string())?;
            data_of(&uri[scheme.len() + 1..]).map(Target::Bytes)
        }
        Some(_) => Err("is an address; only files beside the scene and data: are opened".into()),
    }
}

fn is_scheme(text: &str) -> bool {
    text.starts_with(|c: char| c.is_ascii_alphabetic())
        && text.chars().all(|c| c.is_ascii_alphanumeric() || "+-.".contains(c))
}

fn find_file(path: &Path, uri: &str) -> std::result::Result<PathBuf, String> {
    // The parent of a bare file name is "", which no system call takes for the current folder.
    let folder = path.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."));
    let root = folder.canonicalize().map_err(|e| format!("cannot be found: its folder: {e}"))?;
    let decoded = percent_decode_str(uri).decode_utf8_lossy();
    // Some writers leave a file's name as it is.
    find_inside(&root, &root, &decoded).or_else(|fault| find_inside(&root, &root, uri).map_err(|_| fault))
}

/// The bytes of a `data:` URI, of what follows that word.
fn data_of(rest: &str) -> std::result::Result<Vec<u8>, String> {
    let (kind, data) = rest.split_once(',').ok_or("is no data: URI: it has no comma")?;
    let data: Cow<[u8]> = percent_decode(data.as_bytes()).into();
    if !kind.ends_with(";base64") {
        return Ok(data.into_owned());
    }
    BASE64.decode(data).map_err(|e| format!("is not valid base64: {e}"))
}

/// A URI for a message.
pub(super) fn name_of(uri: &str) -> String {
    quote(uri.as_bytes())
}

/// The buffers of a file.
pub(super) struct Buffers<'a> {
    path: &'a Path,
    root: &'a Root,
    /// By number; none of those that no view is of.
    loaded: BTreeMap<usize, Cow<'a, [u8]>>,
}

impl<'a> Buffers<'a> {
    /// Loads the buffers that views are of; and the files that buffers are in, used or not. `binary` is the second
    /// chunk of a binary file.
    pub fn load(
        path: &'a Path,
        root: &'a Root,
        binary: Option<&'a [u8]>,
        budget: &MemoryBudget,
    ) -> Result<(Buffers<'a>, Vec<SourceFile>)> {
        let mut files = Vec::new();
        for uri in root.buffers.iter().filter_map(|buffer| buffer.uri.as_ref()).take(MAX_FILES) {
            if !uri.starts_with("data:")
                && let Ok(found) = find_file(path, uri)
            {
                let role = format!("the buffer that '{}' names", path.display());
                files.push(SourceFile { path: found, role });
            }
        }
        let mut buffers = Buffers { path, root, loaded: BTreeMap::new() };
        for view in &root.buffer_views {
            let number = view.buffer.value();
            if !buffers.loaded.contains_key(&number) {
                let bytes = buffers.read(number, binary, budget)?;
                buffers.loaded.insert(number, bytes);
            }
        }
        Ok((buffers, files))
    }

    fn fault(&self, message: String) -> Error {
        Error::input(self.path, None, message)
    }

    fn read(&self, number: usize, binary: Option<&'a [u8]>, budget: &MemoryBudget) -> Result<Cow<'a, [u8]>> {
        let buffer = self.root.buffers.get(number);
        let buffer = buffer.ok_or_else(|| self.fault(format!("there is no buffer {number}, which a view is of")))?;
        let bytes: Cow<'a, [u8]> = match (&buffer.uri, binary) {
            (None, Some(binary)) if number == 0 => Cow::Borrowed(binary),
            (None, _) => return Err(self.fault(format!("buffer {number} is nowhere: it has no uri"))),
            (Some(uri), _) => {
                let target = follow(self.path, uri, budget);
                let target = target.map_err(|e| self.fault(format!("buffer {number}, '{}', {e}", name_of(uri))))?;
                Cow::Owned(match target {
                    Target::Bytes(bytes) => bytes,
                    Target::File(file) => read_all(&file, MAX_FILE_BYTES, (1, budget), |_| Ok(()))?,
                })
            }
        };
        let (length, due) = (bytes.len() as u64, buffer.byte_length.0);
        if length < due {
            let message = format!("buffer {number} should have {due} bytes, but has {length}: it is cut short");
            return Err(self.fault(message));
        }
        Ok(bytes)
    }

    /// The bytes of a view.
    pub fn view(&self, index: Index<View>) -> Result<&[u8]> {
        let number = index.value();
        let view = self.root.buffer_views.get(number);
        let view = view.ok_or_else(|| self.fault(format!("there is no bufferView {number}, though it is named")))?;
        let buffer = self.loaded.get(&view.buffer.value()).map_or(&[][..], |bytes| bytes);
        let (offset, length) = (view.byte_offset.map_or(0, |offset| offset.0), view.byte_length.0);
        let range = usize::try_from(offset).ok().zip(offset.checked_add(length).and_then(|end| end.try_into().ok()));
        range.and_then(|(from, to)| buffer.get(from..to)).ok_or_else(|| {
            let (size, buffer) = (buffer.len(), view.buffer.value());
            self.fault(format!(
                "bufferView {number} reaches beyond its buffer: {length} bytes from {offset} of the {size} of buffer \
                 {buffer}"
            ))
        })
    }

    /// How far apart the elements in a view are; none where they follow each other.
    pub fn stride(&self, index: Index<View>) -> Option<usize> {
        self.root.buffer_views.get(index.value())?.byte_stride.map(|stride| stride.0)
    }
}
