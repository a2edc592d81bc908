//! Finds the equal one among many materials or textures, in a time that does not grow with their number.
//!
//! By hash: floats make neither of them a key of a map, because -0 equals 0 and NaN nothing. So equal ones must have
//! equal hashes here, and those of one hash are compared.

use super::{Image, Material, Procedural, Texture};
use glam::{DVec3, Vec3};
use std::collections::HashMap;
use std::hash::{BuildHasher, Hash, Hasher, RandomState};

/// Texels of a picture that its hash looks at, at most.
const SAMPLES: usize = 256;

/// What may be looked for.
pub(super) trait Known: PartialEq {
    /// Hashes what makes most of them differ; alike for equal ones.
    fn hash_for_search(&self, state: &mut impl Hasher);
}

/// The numbers of the items of a list, by their hashes. It learns of new ones when it is asked, however they came into
/// the list, which must only grow.
#[derive(Debug, Clone, Default)]
pub(super) struct Numbers {
    by_hash: HashMap<u64, Vec<u32>>,
    seen: usize,
    hashes: RandomState,
}

impl Numbers {
    /// The number of the first item of `list` that equals `item`.
    pub fn find<T: Known>(&mut self, list: &[T], item: &T) -> Option<u32> {
        for (number, item) in list.iter().enumerate().skip(self.seen) {
            let hash = self.hash(item);
            self.by_hash.entry(hash).or_default().push(number as u32);
        }
        self.seen = list.len();
        let alike = self.by_hash.get(&self.hash(item))?;
        alike.iter().copied().find(|&number| list[number as usize] == *item)
    }

    fn hash<T: Known>(&self, item: &T) -> u64 {
        let mut state = self.hashes.build_hasher();
        item.hash_for_search(&mut state);
        state.finish()
    }
}

/// The sum turns -0 into 0, which equals it.
fn hash_vectors<const N: usize>(vectors: [Vec3; N], state: &mut impl Hasher) {
    vectors.iter().for_each(|v| (*v + 0.0).to_array().map(f32::to_bits).hash(state));
}

impl Known for Material {
    fn hash_for_search(&self, state: &mut impl Hasher) {
        self.name.hash(state);
        self.diffuse_texture.hash(state);
        self.toon.map(|toon| toon.steps).hash(state);
        hash_vectors([self.ambient, self.diffuse, self.specular, self.mirror, self.transmission, self.emission], state);
        hash_vectors([Vec3::new(self.shininess, self.ior, 0.0)], state);
    }
}

impl Known for Texture {
    fn hash_for_search(&self, state: &mut impl Hasher) {
        match self {
            // Not all of a large picture: others of the same name and size mostly differ somewhere here.
            Texture::Image(Image { name, width, height, rgba }) => {
                (name, width, height).hash(state);
                rgba.iter().step_by(rgba.len() / SAMPLES + 1).for_each(|texel| texel.hash(state));
            }
            Texture::Procedural(Procedural { colours, transform, turbulence, octaves, seed, .. }) => {
                (octaves, seed).hash(state);
                hash_vectors([colours[0], colours[1], Vec3::splat(*turbulence)], state);
                let m = transform.matrix3;
                let bits = |v: DVec3| (v + 0.0).to_array().map(f64::to_bits);
                [m.x_axis, m.y_axis, m.z_axis, transform.translation].map(bits).hash(state);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::Pattern;
    use std::cell::Cell;

    thread_local!(static COMPARED: Cell<usize> = const { Cell::new(0) });

    struct Counted(u64);

    impl PartialEq for Counted {
        fn eq(&self, other: &Counted) -> bool {
            COMPARED.set(COMPARED.get() + 1);
            self.0 == other.0
        }
    }

    impl Known for Counted {
        fn hash_for_search(&self, state: &mut impl Hasher) {
            self.0.hash(state);
        }
    }

    #[test]
    fn the_first_equal_one_is_found_without_looking_at_all_others() {
        let (mut numbers, mut list) = (Numbers::default(), Vec::new());
        for i in 0..20_000 {
            let item = Counted(i % 15_000);
            let found = numbers.find(&list, &item);
            assert_eq!(found, (i >= 15_000).then_some((i % 15_000) as u32));
            if found.is_none() || i % 7 == 0 {
                list.push(item); // of some there are two: the first is found
            }
        }
        assert!(COMPARED.get() < 10_000, "{} comparisons", COMPARED.get());
    }

    #[test]
    fn equal_ones_have_equal_hashes() {
        let mut numbers = Numbers::default();
        let zero = Material { mirror: Vec3::ZERO, ior: 1.5, ..Material::default() };
        let list = [Material { name: "other".into(), ..zero.clone() }, zero.clone()];
        assert_eq!(numbers.find(&list, &Material { mirror: -Vec3::ZERO, ..zero.clone() }), Some(1));
        assert_eq!(numbers.find(&list, &Material { ior: f32::NAN, ..zero }), None);
        let mut textures = Numbers::default();
        let patterns = [Pattern::Wood, Pattern::Marble].map(|pattern| Texture::from(Procedural::new(pattern)));
        assert_eq!(textures.find(&patterns, &patterns[1].clone()), Some(1));
    }
}
