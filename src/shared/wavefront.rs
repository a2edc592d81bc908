//! What the wavefront kernels (`cl/kernels/wavefront.cl`) and the host share beyond what the mega-kernel needs: queues
//! and the state of slots.

use crate::layout::{Float4, Int4, device_const, device_struct};

device_const! {
    /// Queues of the wavefront kernels.
    pub group QUEUES;
    /// `WavefrontSlot::path` of a slot that follows none.
    pub const NO_PATH: u32 = u32::MAX;
    /// Of the lengths of the wavefront kernels' queues: slots that trace a ray in this wave.
    pub const QUEUE_ACTIVE: u32 = 0;
    /// Slots whose ray has hit something.
    pub const QUEUE_HITS: u32 = 1;
    /// Requests for colours of textures.
    pub const QUEUE_TEXTURED: u32 = 2;
    /// Paths of the batch that were given to slots; slots that came too late count, too.
    pub const QUEUE_PATHS: u32 = 3;
    /// Rays of the wave that the second pass traced.
    pub const QUEUE_RESOLVED: u32 = 4;
    /// Shadow rays towards the first light; the other lights' follow.
    pub const QUEUE_SHADOWS: u32 = 5;
}

device_struct! {
    /// A slot follows one path after the other: a sample of a pixel and all the rays that come of it.
    pub struct WavefrontSlot {
        /// Radiance of the path so far in x, y, z; w unused.
        pub radiance: Float4,
        /// Number of the path in its batch, or NO_PATH.
        pub path: u32,
        /// How many rays wait to be traced.
        pub pending: u32,
        /// Number of this wave's texture request, where there is one.
        pub request: u32,
        /// Unused.
        pub pad: u32,
    }
}

device_struct! {
    /// What the lights need to know of a hit.
    pub struct WavefrontSurface {
        /// Position in x, y, z and bound of its error in w.
        pub position_error: Float4,
        /// What that leaves out of the position in x, y, z; x of the way to where shadow rays start in w.
        pub position_low_lift_x: Float4,
        /// Where that is on the triangle, as weights of the vertices, in x, y, z; w unused.
        pub weights: Float4,
        /// Bits of the geometric normal in x, y, z and the triangle in w.
        pub geometric_normal_primitive: Int4,
        /// Bits of the shading normal in x, y, z and the material in w.
        pub normal_material: Int4,
        /// Unit direction of the ray that found it in x, y, z; y of that way in w.
        pub view_direction_lift_y: Float4,
        /// Diffuse colour, textured, in x, y, z; z of that way in w.
        pub diffuse_lift_z: Float4,
    }
}

device_struct! {
    /// What the ray of this wave brings its path.
    pub struct WavefrontYield {
        /// Radiance along the ray so far in x, y, z; w unused.
        pub radiance: Float4,
        /// What it is multiplied by in x, y, z; w unused.
        pub weight: Float4,
    }
}

device_struct! {
    /// A ray to a light.
    pub struct WavefrontShadow {
        /// Direction, of the light's distance where t_far is 1, in x, y, z and t_far in w.
        pub to_light_t_far: Float4,
        /// Bits of what the light adds where nothing is in its way in x, y, z and the slot in w.
        pub reflected_slot: Int4,
    }
}

device_struct! {
    /// A hit whose colour the host shall compute.
    pub struct TextureRequest {
        /// Direction of the ray in x, y, z and the width of its cone where it hits in w.
        pub direction_width: Float4,
        /// Weight of vertex 0.
        pub weight0: f32,
        /// Weight of vertex 1.
        pub u: f32,
        /// Weight of vertex 2.
        pub v: f32,
        /// The triangle that was hit.
        pub primitive: u32,
    }
}
