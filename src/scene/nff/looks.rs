//! Colours and materials of NFF files.

use super::Reader;
use crate::scene::check::material_fault;
use crate::scene::text::quote;
use crate::scene::words::Word;
use crate::scene::{Material, mtl};
use glam::Vec3;

impl<'a> Reader<'a> {
    /// The next `N` numbers of an entity that describes looks. When they are not there, or one is NaN, infinite or
    /// negative, none, with a warning: looks that make no sense are left out, as those of an MTL library.
    pub(super) fn looks<const N: usize>(&mut self, entity: Word) -> Option<[f32; N]> {
        let mut numbers = [0.0; N];
        for (i, number) in numbers.iter_mut().enumerate() {
            match self.words.peek().and_then(Word::number) {
                Some(value) => *number = value,
                None => {
                    let message = format!("'{}' has {i} numbers, not {N}, and is ignored", quote(entity.text));
                    self.warnings.add(self.path, entity.line, message);
                    return None;
                }
            }
            self.next_word();
        }
        if let Some(bad) = numbers.iter().find(|&&n| !(n >= 0.0 && n.is_finite())) {
            let message = format!("'{}' has {bad}, not a number from 0, and is ignored", quote(entity.text));
            self.warnings.add(self.path, entity.line, message);
            return None;
        }
        Some(numbers)
    }

    /// Makes what an `f` describes the current material.
    pub(super) fn read_material(&mut self, entity: Word) {
        let Some(numbers) = self.looks::<8>(entity) else { return };
        let key = numbers.map(f32::to_bits);
        if let Some(&id) = self.materials.get(&key) {
            self.builder.use_material(id);
            return;
        }
        if self.materials.len() == mtl::MAX_MATERIALS {
            self.extra_materials.note(entity.line);
            return;
        }
        let [red, green, blue, kd, ks, shine, t, ior] = numbers;
        let wanted = (Vec3::new(red, green, blue) * kd, ks, t);
        let (diffuse, ks, t) = (wanted.0.min(Vec3::ONE), ks.min(1.0), t.min(1.0));
        if wanted != (diffuse, ks, t) {
            self.warnings.add(self.path, entity.line, "'f' reflects or transmits more than 1, which is taken instead");
        }
        let mut material = Material {
            name: format!("f of line {}", entity.line),
            specular: Vec3::splat(ks),
            shininess: shine.min(Material::MAX_SHININESS),
            mirror: Vec3::splat(ks),
            transmission: Vec3::splat(t),
            ior: if t > 0.0 { ior } else { 1.0 }, // opaque surfaces mostly have 0
            ..Material::matt(diffuse)
        };
        if let Some(fault) = material_fault(&material) {
            let message = format!("'f': {} {}; 1 is taken", fault.key, fault.message);
            self.warnings.add(self.path, entity.line, message);
            material.ior = 1.0;
        }
        let id = self.builder.push_material(material);
        self.materials.insert(key, id);
        self.builder.use_material(id);
    }
}
