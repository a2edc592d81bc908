//! What a picture shows, and how.

use crate::error::{Error, Result};
use crate::layers::{Layer, check_layers};
use crate::renderer::{Crop, DEFAULT_DEPTH, DEFAULT_SIZE};
use crate::scene::{Aim, Camera, PictureDefaults, Samples, Viewpoint};

/// A picture to render: its size, and what is left to the scene unless it is set.
///
/// What neither the view nor the scene's file says: 1024 x 768 pixels, a camera that frames the scene, an error of one
/// step of 8-bit sRGB, and chains of at most 8 rays. Of the camera each part can be said by itself; the scene's camera
/// has the others, or else one that is placed so that the whole scene is in the picture, or inside of it if it is a
/// room.
///
/// A scene without lights is lit as in a studio: by a lamp above the camera's left shoulder, inside of it
/// ([`Viewpoint::Inside`]) where the camera is, by a sky and a little from the viewer, before a light background. It is
/// sent to the device again whenever that lamp moves with the camera; one with a light is not.
///
/// ```
/// use raybrook::{Camera, View, Viewpoint};
///
/// let (eye, target, up) = ([0.0, 1.0, 5.0].into(), [0.0; 3].into(), [0.0, 1.0, 0.0].into());
/// let camera = Camera { eye, target, up, fov_degrees: 40.0 };
/// let view = View::new(640, 480).camera(camera).samples(16).depth(4);
/// let from_above = View::new(640, 480).viewpoint(Viewpoint::Top).up([0.0, 0.0, 1.0]).fov(30.0);
/// let from_here = View::new(640, 480).eye([2.0, 1.0, 5.0]); // at the middle of the scene
/// # let _ = (view, from_above, from_here);
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct View {
    size: Option<(u32, u32)>,
    aim: Aim,
    samples: Option<Samples>,
    depth: Option<u32>,
    crop: Option<Crop>,
    /// A bit for each layer, by its place in [`Layer::ALL`].
    layers: u32,
}

/// A view with all that it leaves to the scene, apart from the camera.
pub(super) struct Frame {
    pub size: (u32, u32),
    pub samples: Samples,
    pub depth: u32,
    pub aim: Aim,
    pub crop: Option<Crop>,
    pub layers: Vec<Layer>,
}

impl View {
    /// A picture of `width` x `height` pixels, each 1 to 65535. [`View::default`] has the size that the scene's file
    /// says.
    pub fn new(width: u32, height: u32) -> View {
        View { size: Some((width, height)), ..View::default() }
    }

    /// All of the camera; instead of the scene's.
    #[must_use]
    pub fn camera(self, camera: Camera) -> View {
        View { aim: camera.into(), ..self }
    }

    /// Where the camera is, world units.
    #[must_use]
    pub fn eye(self, eye: [f32; 3]) -> View {
        View { aim: Aim { eye: Some(eye.into()), ..self.aim }, ..self }
    }

    /// What is in the middle of the picture, world units.
    #[must_use]
    pub fn target(self, target: [f32; 3]) -> View {
        View { aim: Aim { target: Some(target.into()), ..self.aim }, ..self }
    }

    /// Which way is up, a direction of any length. Where neither view nor scene says it, z is up in `.stl` and `.3mf`
    /// files, y in scene files and glTF, and in others what the program that wrote the file, or the model's shape,
    /// tells for sure: else y.
    #[must_use]
    pub fn up(self, up: [f32; 3]) -> View {
        View { aim: Aim { up: Some(up.into()), ..self.aim }, ..self }
    }

    /// The vertical angle of view, degrees, between 0 and 180.
    #[must_use]
    pub fn fov(self, degrees: f32) -> View {
        View { aim: Aim { fov_degrees: Some(degrees), ..self.aim }, ..self }
    }

    /// From where to look: the camera is placed by itself, so that everything is in the picture. Not together with
    /// [`View::eye`] and [`View::target`].
    #[must_use]
    pub fn viewpoint(self, viewpoint: Viewpoint) -> View {
        View { aim: Aim { viewpoint: Some(viewpoint), ..self.aim }, ..self }
    }

    /// So many rays through each pixel, in a fixed pattern, 1 to 65536; takes the place of [`View::error`].
    #[must_use]
    pub fn samples(self, per_pixel: u32) -> View {
        View { samples: Some(Samples::PerPixel(per_pixel)), ..self }
    }

    /// As many rays as the picture needs for this error: the root of its mean square, in steps of 8-bit sRGB, 0 to 255.
    /// A pixel has at most 256. Takes the place of [`View::samples`].
    #[must_use]
    pub fn error(self, steps: f32) -> View {
        View { samples: Some(Samples::Error(steps)), ..self }
    }

    /// The longest chain of reflected and refracted rays, 1 to 64; 1 is the camera ray alone.
    #[must_use]
    pub fn depth(self, depth: u32) -> View {
        View { depth: Some(depth), ..self }
    }

    /// Only a part of the picture: `width` x `height` pixels from column `x` and row `y` on, with the bits that the
    /// whole picture has there. With [`View::samples`] only the part is rendered, with an error the blocks that have
    /// pixels in it.
    #[must_use]
    pub fn crop(self, x: u32, y: u32, width: u32, height: u32) -> View {
        View { crop: Some(Crop { place: (x, y), size: (width, height) }), ..self }
    }

    /// What else to tell of the pixels, as [`Picture::layers`](crate::Picture::layers): depth, normals, numbers of
    /// objects and more. Takes the place of the layers that were asked for before.
    #[must_use]
    pub fn layers(self, layers: &[Layer]) -> View {
        View { layers: layers.iter().fold(0, |all, &layer| all | 1 << layer as u32), ..self }
    }

    /// The view with what `scene` says of its picture where this one says nothing.
    ///
    /// # Errors
    /// [`Error::Option`] for a size, samples or depth out of range, a part or a layer that the picture has not, and a
    /// camera that sees nothing.
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
        self.crop.map_or(Ok(()), |crop| crop.check(size))?;
        self.aim.check()?;
        let layers: Vec<_> = Layer::ALL.iter().copied().filter(|&layer| self.layers >> layer as u32 & 1 != 0).collect();
        check_layers(&layers, samples)?;
        Ok(Frame { size, samples, depth, aim: self.aim, crop: self.crop, layers })
    }
}
