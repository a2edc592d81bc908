//! What a picture shows, and how.

use crate::error::{Error, Result};
use crate::renderer::{DEFAULT_DEPTH, DEFAULT_SIZE};
use crate::scene::{Camera, PictureDefaults, Samples, Scene};

/// A picture to render: its size, and what is left to the scene unless it is set.
///
/// What neither the view nor the scene's file says: 1024 x 768 pixels, a camera that frames the scene, an error of one
/// step of 8-bit sRGB, and chains of at most 8 rays.
///
/// ```
/// use raybrook::{Camera, View};
///
/// let camera = Camera { eye: [0.0, 1.0, 5.0].into(), target: [0.0; 3].into(), up: [0.0, 1.0, 0.0].into(), fov_degrees: 40.0 };
/// let view = View::new(640, 480).camera(camera).samples(16).depth(4);
/// # let _ = view;
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct View {
    size: Option<(u32, u32)>,
    camera: Option<Camera>,
    samples: Option<Samples>,
    depth: Option<u32>,
}

/// A view with all that it leaves to the scene, apart from the camera.
pub(super) struct Frame {
    pub size: (u32, u32),
    pub samples: Samples,
    pub depth: u32,
    pub camera: Option<Camera>,
}

impl View {
    /// A picture of `width` x `height` pixels, each 1 to 65535. [`View::default`] has the size that the scene's file
    /// says.
    pub fn new(width: u32, height: u32) -> View {
        View { size: Some((width, height)), ..View::default() }
    }

    /// Where from; instead of the scene's camera.
    #[must_use]
    pub fn camera(self, camera: Camera) -> View {
        View { camera: Some(camera), ..self }
    }

    /// So many rays through each pixel, in a fixed pattern, 1 to 65536; takes the place of [`View::error`].
    #[must_use]
    pub fn samples(self, per_pixel: u32) -> View {
        View { samples: Some(Samples::PerPixel(per_pixel)), ..self }
    }

    /// As many rays as the picture needs for this error: the root of its mean square, in steps of 8-bit sRGB, 0 to 255.
    /// A pixel has at most
    /// 256. Takes the place of [`View::samples`].
    #[must_use]
    pub fn error(self, steps: f32) -> View {
        View { samples: Some(Samples::Error(steps)), ..self }
    }

    /// The longest chain of reflected and refracted rays, 1 to 64; 1 is the camera ray alone.
    #[must_use]
    pub fn depth(self, depth: u32) -> View {
        View { depth: Some(depth), ..self }
    }

    /// The view with what `scene` says of its picture where this one says nothing.
    ///
    /// # Errors
    /// [`Error::Option`] for a size, samples or depth out of range; [`Error::Scene`] for a camera that sees nothing.
    pub(super) fn over(&self, scene: &PictureDefaults) -> Result<Frame> {
        let size = self.size.or(scene.size).unwrap_or(DEFAULT_SIZE);
        let samples = self.samples.or(scene.samples).unwrap_or(Samples::DEFAULT);
        let depth = self.depth.or(scene.depth).unwrap_or(DEFAULT_DEPTH);
        let most = PictureDefaults::MAX_SIDE;
        if [size.0, size.1].into_iter().any(|side| !(1..=most).contains(&side)) {
            let message = format!("{}x{}: each side must be 1 to {most} pixels", size.0, size.1);
            return Err(Error::option("size", message));
        }
        samples.check(size)?;
        if !(1..=PictureDefaults::MAX_DEPTH).contains(&depth) {
            return Err(Error::option("depth", format!("{depth} is not in 1 to {}", PictureDefaults::MAX_DEPTH)));
        }
        if let Some(camera) = self.camera {
            Scene { camera: Some(camera), ..Scene::default() }.check_values()?;
        }
        Ok(Frame { size, samples, depth, camera: self.camera })
    }
}
