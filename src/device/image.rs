//! Arrays of 16-byte records or of 32-bit numbers as images, which GPUs read through their texture caches.
//!
//! Texels are integers (`read_imagei`, `read_imageui`) whatever the records hold: conversions of floats might flush
//! denormals, which index bits look like.

use super::handle::Owned;
use super::{Buffer, DeviceContext, Event};
use crate::error::{Error, Result};
use bytemuck::Pod;
use opencl3::error_codes::ClError;
use opencl3::memory::{
    CL_MEM_OBJECT_IMAGE1D_BUFFER, CL_MEM_OBJECT_IMAGE2D, CL_MEM_READ_ONLY, CL_R, CL_RGBA, CL_SIGNED_INT32,
    CL_UNSIGNED_INT32, ClMem, Image as ClImage,
};
use opencl3::types::{CL_TRUE, cl_image_desc, cl_image_format};
use std::ptr;
use std::sync::Arc;

/// Texels a row of a two-dimensional image: every device of the full profile takes 8192.
pub const IMAGE_WIDTH: usize = 4096;

/// How the records lie in the image.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ImageShape {
    /// `image1d_buffer_t`: record i is texel i.
    Buffer,
    /// `image2d_t`: record i is texel (i mod [`IMAGE_WIDTH`], i / [`IMAGE_WIDTH`]).
    Rows,
}

/// Records in an image that kernels read. Kernels keep it alive, as they do with buffers.
#[derive(Debug)]
pub struct Image(Arc<ImageMemory>);

/// The image and, for a buffer image, the buffer behind it.
#[derive(Debug)]
pub(super) struct ImageMemory {
    pub raw: Owned<ClImage>,
    _buffer: Option<Buffer<u8>>,
}

// SAFETY: OpenCL's calls on memory objects may come from any thread (OpenCL 1.2, appendix A.2); opencl3 says so of its
// buffers and forgot its images.
unsafe impl Sync for ImageMemory {}

impl Image {
    /// An image of `data`, records of 16 or 4 bytes; `what` names it in errors. `data` may be empty.
    ///
    /// # Errors [`Error::NoDevice`] when the device has no images, [`Error::TooLarge`] over its limits,
    /// [`Error::OpenCl`] when the driver refuses.
    ///
    /// # Panics
    /// When records have another size.
    pub fn from_slice<T: Pod>(context: &DeviceContext, what: &str, data: &[T], shape: ImageShape) -> Result<Self> {
        let (order, kind) = match size_of::<T>() {
            16 => (CL_RGBA, CL_SIGNED_INT32),
            4 => (CL_R, CL_UNSIGNED_INT32),
            size => panic!("records of {size} bytes are no texels"),
        };
        let format = cl_image_format { image_channel_order: order, image_channel_data_type: kind };
        let info = context.info();
        if !info.images {
            let message =
                format!("device '{}' has no images, which {what} were to lie in; take `memory = global`", info.name);
            return Err(Error::NoDevice(message));
        }
        // No image is empty. A texel that no index reaches is zero.
        let texels = data.len().max(1);
        let mut bytes = bytemuck::cast_slice::<T, u8>(data).to_vec();
        match shape {
            ImageShape::Buffer => {
                let limit = info.image1d_buffer_max_texels;
                check(context, what, texels, limit, "CL_DEVICE_IMAGE_MAX_BUFFER_SIZE", size_of::<T>())?;
                bytes.resize(texels * size_of::<T>(), 0);
                let buffer = Buffer::from_slice(context, what, &bytes)?;
                let desc = cl_image_desc {
                    image_type: CL_MEM_OBJECT_IMAGE1D_BUFFER,
                    image_width: texels,
                    buffer: buffer.memory().raw.get(),
                    ..empty_desc()
                };
                let raw = create(context, what, &format, &desc)?;
                Ok(Image(Arc::new(ImageMemory { raw, _buffer: Some(buffer) })))
            }
            ImageShape::Rows => {
                let rows = texels.div_ceil(IMAGE_WIDTH);
                let limit = match info.image2d_max_width >= IMAGE_WIDTH {
                    true => info.image2d_max_height.saturating_mul(IMAGE_WIDTH),
                    false => 0,
                };
                check(context, what, texels, limit, "CL_DEVICE_IMAGE2D_MAX_HEIGHT", size_of::<T>())?;
                bytes.resize(rows * IMAGE_WIDTH * size_of::<T>(), 0);
                let desc = cl_image_desc {
                    image_type: CL_MEM_OBJECT_IMAGE2D,
                    image_width: IMAGE_WIDTH,
                    image_height: rows,
                    ..empty_desc()
                };
                let mut raw = create(context, what, &format, &desc)?;
                write_rows(context, what, &mut raw, rows, &mut bytes)?;
                Ok(Image(Arc::new(ImageMemory { raw, _buffer: None })))
            }
        }
    }

    pub(super) fn memory(&self) -> &Arc<ImageMemory> {
        &self.0
    }
}

fn empty_desc() -> cl_image_desc {
    cl_image_desc {
        image_type: 0,
        image_width: 0,
        image_height: 0,
        image_depth: 0,
        image_array_size: 0,
        image_row_pitch: 0,
        image_slice_pitch: 0,
        num_mip_levels: 0,
        num_samples: 0,
        buffer: ptr::null_mut(),
    }
}

fn check(
    context: &DeviceContext,
    what: &str,
    texels: usize,
    limit: usize,
    limit_name: &'static str,
    texel_bytes: usize,
) -> Result<()> {
    if texels <= limit {
        return Ok(());
    }
    Err(Error::TooLarge {
        device: context.info().name.clone(),
        what: format!("the image of {what} (`memory = global` has no such limit)"),
        needed_bytes: (texels * texel_bytes) as u64,
        limit_name,
        limit_bytes: (limit * texel_bytes) as u64,
    })
}

fn create(
    context: &DeviceContext,
    what: &str,
    format: &cl_image_format,
    desc: &cl_image_desc,
) -> Result<Owned<ClImage>> {
    let _watched = context.watch("clCreateImage");
    // SAFETY: format and description live through the call, which copies them; no host pointer is given.
    let raw = unsafe { ClImage::create(&context.0.shared.context, CL_MEM_READ_ONLY, format, desc, ptr::null_mut()) };
    raw.map(|raw| Owned::new(raw, &context.0.owner)).map_err(|e| context.error(&format!("clCreateImage for {what}"), e))
}

fn write_rows(
    context: &DeviceContext,
    what: &str,
    image: &mut Owned<ClImage>,
    rows: usize,
    bytes: &mut [u8],
) -> Result<()> {
    let (origin, region) = ([0usize; 3], [IMAGE_WIDTH, rows, 1]);
    let watched = context.watch_transfer("clEnqueueWriteImage");
    // SAFETY: the call blocks, so `bytes` outlives the transfer; they are exactly the region's texels, rows without
    // gaps.
    let event: std::result::Result<_, ClError> = unsafe {
        let (origin, region) = (origin.as_ptr(), region.as_ptr());
        context.0.queue.enqueue_write_image(image, CL_TRUE, origin, region, 0, 0, bytes.as_mut_ptr().cast(), &[])
    };
    drop(watched);
    let call = format!("clEnqueueWriteImage of {what}");
    let event = event.map_err(|e| context.error(&call, e))?;
    Event::check_transfer(context.clone(), call, event)
}
