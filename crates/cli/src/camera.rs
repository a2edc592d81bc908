//! Options of the camera: what of it is given, and how it is typed.

use super::heading;
use super::values::Named;
use clap::builder::{PossibleValue, PossibleValuesParser, TypedValueParser};
use raybrook::Viewpoint;
use raybrook::glam::Vec3;
use raybrook::low_level::scene::Aim;

/// Parts of the camera, in place of the scene's.
#[derive(clap::Args)]
pub struct CameraArgs {
    /// Where the camera is [default: the scene's, else from where everything is in the picture].
    #[arg(
        long,
        help_heading = heading::CAMERA,
        hide_short_help = true,
        value_name = "X,Y,Z",
        allow_hyphen_values = true,
        value_parser = parse_vector,
    )]
    eye: Option<Vec3>,
    /// What is in the middle of the picture [default: the scene's, else the middle of everything].
    #[arg(
        long,
        help_heading = heading::CAMERA,
        hide_short_help = true,
        value_name = "X,Y,Z",
        allow_hyphen_values = true,
        value_parser = parse_vector,
    )]
    target: Option<Vec3>,
    /// Which way is up: an axis, or a direction X,Y,Z [default: the scene's, else that of its format or its shape].
    ///
    /// z in .stl and .3mf files, y in scene files, .gltf and .glb. Of others some programs that write them are known to
    /// have z up; and a model is seen with z up that has level ground across z and none across y, is a terrain over x
    /// and y, or stands on a flat base across z and would tip over along y. All else has y up. --explain tells.
    #[arg(
        long,
        help_heading = heading::CAMERA,
        hide_short_help = true,
        value_name = "AXIS|X,Y,Z",
        allow_hyphen_values = true,
        value_parser = up_parser(),
    )]
    up: Option<Vec3>,
    /// Vertical field of view in degrees, between 0 and 180 [default: the scene's, else 40, inside 65].
    #[arg(
        long,
        help_heading = heading::CAMERA,
        hide_short_help = true,
        value_name = "DEGREES",
        allow_hyphen_values = true,
    )]
    fov: Option<f32>,
    /// From where to look; the camera is placed by itself.
    ///
    /// Everything is in the picture, but for `inside`. In place of the scene's camera, of which only up and field of
    /// view stay. Not together with --eye and --target. A camera in front looks along -z where y is up, and along y
    /// where z is.
    #[arg(
        long,
        help_heading = heading::CAMERA,
        hide_short_help = true,
        value_name = "VIEW",
        conflicts_with_all = ["eye", "target"],
        value_parser = viewpoint_parser(),
    )]
    view: Option<Viewpoint>,
}

impl CameraArgs {
    /// What the options say.
    pub fn aim(&self) -> Aim {
        Aim { eye: self.eye, target: self.target, up: self.up, fov_degrees: self.fov, viewpoint: self.view }
    }
}

fn viewpoint_parser() -> impl TypedValueParser<Value = Viewpoint> {
    let names = Viewpoint::ALL.iter().map(|viewpoint| PossibleValue::new(viewpoint.name()).help(viewpoint.about()));
    PossibleValuesParser::new(names).try_map(|name| name.parse::<Viewpoint>())
}

/// Three numbers with commas between them.
fn parse_vector(text: &str) -> Result<Vec3, String> {
    let numbers: Option<Vec<f32>> = text.split(',').map(|part| part.trim().parse().ok()).collect();
    match numbers.as_deref() {
        Some(&[x, y, z]) if Vec3::new(x, y, z).is_finite() => Ok(Vec3::new(x, y, z)),
        _ => Err("expected three finite numbers with commas between them, such as 1,2.5,-3".into()),
    }
}

/// The axes, and the directions that they are.
const AXES: [(&str, Vec3); 6] =
    [("x", Vec3::X), ("y", Vec3::Y), ("z", Vec3::Z), ("-x", Vec3::NEG_X), ("-y", Vec3::NEG_Y), ("-z", Vec3::NEG_Z)];

fn up_parser() -> impl TypedValueParser<Value = Vec3> {
    Named::new(AXES.map(|(name, _)| name), parse_up)
}

fn parse_up(text: &str) -> Result<Vec3, String> {
    if let Some((_, axis)) = AXES.iter().find(|(name, _)| name.eq_ignore_ascii_case(text)) {
        return Ok(*axis);
    }
    parse_vector(text).map_err(|_| "expected x, y, z, -x, -y, -z, or three finite numbers such as 0,1,0".into())
}
