//! What stands in a room: along the far wall, in the middle, on the walls.

use super::super::super::mesh::{Block, Mesh, union_of};
use super::super::super::texture;
use super::super::parts::{metal, panel};
use super::Making;
use crate::radiometry::Rgb;
use crate::scene::Material;
use glam::{Affine3A, Quat, Vec2, Vec3};

/// Height of a table, metres.
const TABLE: f32 = 0.74;
/// How far bodies stand clear of what carries them, metres.
const CLEARANCE: f32 = 0.001;

impl Making {
    /// Fills the room.
    pub(super) fn furnish(&mut self) {
        self.far_wall();
        match self.chance.unit() {
            kind if kind < 0.3 => self.partition(),
            kind if kind < 0.8 => self.table(),
            _ => {}
        }
        self.balls();
        self.hangings();
    }

    /// Two to four places along the wall at z = 0, side by side.
    fn far_wall(&mut self) {
        let count = 2 + (3.0 * self.chance.unit()) as u32;
        let step = self.size.x / count as f32;
        for place in 0..count {
            let width = self.chance.between(0.4, 0.9) * step;
            let left = place as f32 * step + self.chance.between(0.0, 1.0) * (step - width);
            // Touching the wall, or just not.
            let gap = if self.chance.unit() < 0.5 { 0.0 } else { self.chance.between(0.005, 0.1) };
            match self.chance.unit() {
                kind if kind < 0.35 => self.cupboard([left, gap], width),
                kind if kind < 0.65 => self.shelves([left, gap], width),
                kind if kind < 0.85 => self.plinth([left, gap], width),
                _ => {}
            }
        }
    }

    fn cupboard(&mut self, [left, back]: [f32; 2], width: f32) {
        let height = self.chance.between(0.5, 0.85 * self.size.y);
        let front = back + self.chance.between(0.3, 0.6);
        let paint = self.finish("cupboard");
        let block = ([left, 0.0, back], [left + width, height, front]);
        self.writer.body("cupboard", &union_of(&[block]), paint);
    }

    /// Boards between two sides, with books of random sizes.
    fn shelves(&mut self, [left, back]: [f32; 2], width: f32) {
        let wood = self.finish("shelves");
        let depth = self.chance.between(0.22, 0.4);
        let count = 2 + (3.0 * self.chance.unit()) as u32;
        let rise = self.chance.between(0.28, 0.42);
        let (right, front) = (left + width, back + depth);
        let top = count as f32 * rise + 0.02;
        let mut blocks: Vec<Block> = vec![
            ([left, 0.0, back], [left + 0.02, top, front]),
            ([right - 0.02, 0.0, back], [right, top, front]),
        ];
        for board in 0..=count {
            let low = board as f32 * rise;
            blocks.push(([left, low, back], [right, low + 0.02, front]));
        }
        self.writer.body("shelves", &union_of(&blocks), wood);
        let covers: Vec<usize> = (0..3).map(|_| self.finish("books")).collect();
        for (index, cover) in covers.into_iter().enumerate() {
            // Those of one cover keep to a depth of their own: they may overlap others.
            let deep = 0.004 * index as f32;
            let mut books = Mesh::default();
            for board in 0..count {
                let foot = board as f32 * rise + 0.02 + CLEARANCE;
                let at = self.chance.between(0.05, 0.8) * width + left;
                let thickness = self.chance.between(0.02, 0.12 * width + 0.02);
                let height = self.chance.between(0.5, 0.85) * rise;
                let low = [at, foot, back + 0.021 + deep];
                let end = (at + thickness).min(right - 0.03);
                books.add(union_of(&[(low, [end, foot + height, front - 0.02 - deep])]));
            }
            self.writer.body("books", &books, cover);
        }
    }

    /// A low block with something round on it.
    fn plinth(&mut self, [left, back]: [f32; 2], width: f32) {
        let width = width.min(0.7);
        let (height, depth) = (self.chance.between(0.3, 0.9), self.chance.between(0.3, 0.5));
        let stone = self.finish("plinth");
        let block = ([left, 0.0, back], [left + width, height, back + depth]);
        self.writer.body("plinth", &union_of(&[block]), stone);
        let radius = self.chance.between(0.2, 0.45) * width.min(depth);
        let at = Vec3::new(left + 0.5 * width, height + CLEARANCE, back + 0.5 * depth);
        self.round(at, radius);
    }

    /// A ball, a drum or an egg that stands on a point.
    fn round(&mut self, at: Vec3, radius: f32) {
        let own = self.finish("round");
        let height = self.chance.between(1.0, 3.0) * radius;
        let mesh = match self.chance.unit() {
            kind if kind < 0.4 => Mesh::sphere(radius, 20, 40).at(radius * Vec3::Y),
            kind if kind < 0.7 => Mesh::drum(radius, 0.0, height, 0.1 * radius, 40),
            _ => Mesh::spheroid(radius, 0.5 * height, 20, 40).at(0.5 * height * Vec3::Y),
        };
        self.writer.body("round", &mesh.at(at), own);
    }

    /// A wall that stands out from the one at x = 0, some as high as the room.
    fn partition(&mut self) {
        let Vec3 { x, y, z } = self.size;
        let height = if self.chance.unit() < 0.4 { y } else { self.chance.between(1.0, 0.9 * y) };
        let near = self.chance.between(0.4, 0.55) * z;
        let reach = self.chance.between(0.3, 0.6) * x;
        let thickness = self.chance.between(0.03, 0.2);
        let paint = self.finish("partition");
        let block = ([0.0, 0.0, near], [reach, height, near + thickness]);
        self.writer.body("partition", &union_of(&[block]), paint);
    }

    /// A table that is turned by chance, with things on it, and a stool beside.
    fn table(&mut self) {
        let wood = self.finish("table");
        let [half_x, half_z] = [0.7, 0.4].map(|half| half * self.chance.between(0.7, 1.1));
        let top = ([-half_x, TABLE - 0.03, -half_z], [half_x, TABLE, half_z]);
        let mut blocks: Vec<Block> = vec![top];
        for (x, z) in [(-1.0, -1.0), (-1.0, 1.0), (1.0, -1.0), (1.0, 1.0)] {
            let [x, z] = [x * (half_x - 0.05), z * (half_z - 0.05)];
            blocks.push(([x - 0.03, 0.0, z - 0.03], [x + 0.03, TABLE - 0.03, z + 0.03]));
        }
        let at = Vec3::new(
            self.chance.between(0.4, 0.6) * self.size.x,
            0.0,
            self.chance.between(0.5, 0.57) * self.size.z,
        );
        let turn = Quat::from_rotation_y(self.chance.between(-0.6, 0.6));
        let place = Affine3A::from_rotation_translation(turn, at);
        self.writer.body("table", &union_of(&blocks).moved(place), wood);
        for side in [-0.6, 0.0, 0.6] {
            if self.chance.unit() < 0.6 {
                let on = Vec3::new(side * half_x, TABLE + CLEARANCE, 0.0);
                let radius = self.chance.between(0.03, 0.16);
                self.round(place.transform_point3(on), radius);
            }
        }
        let seat = self.finish("stool");
        let on = Vec3::new(self.chance.between(-0.4, 0.4), CLEARANCE, half_z + 0.25);
        let stool = Mesh::drum(0.18, 0.0, 0.45, 0.02, 40).at(place.transform_point3(on));
        self.writer.body("stool", &stool, seat);
    }

    /// Up to three balls on the floor, before the far wall's furniture.
    fn balls(&mut self) {
        let count = (4.0 * self.chance.unit()) as u32;
        for index in 0..count {
            let radius = self.chance.between(0.08, 0.2);
            let along = (index as f32 + 0.5) / count as f32 * self.size.x;
            let at = Vec3::new(along, CLEARANCE, 0.76 + radius);
            self.round(at, radius);
        }
    }

    /// A mirror, or a picture, on the wall at large x.
    fn hangings(&mut self) {
        let kind = self.chance.unit();
        if kind > 0.6 {
            return;
        }
        let Vec3 { x, y, z } = self.size;
        let low = self.chance.between(0.3, 0.9);
        let height = self.chance.between(0.5, 0.9 * y - low);
        let width = self.chance.between(0.5, 1.4);
        let near = self.chance.between(0.2, 0.5) * z + width;
        let corner = Vec3::new(x - 0.01, low, near - width);
        let sheet = panel(corner, width * Vec3::Z, height * Vec3::Y);
        let mesh = Mesh::quads([&sheet]).with_uvs(|p| Vec2::new(p.z, p.y) - Vec2::new(near, low));
        if kind < 0.25 && !self.is_sunny {
            self.has_mirror = true;
            let silver = self.writer.material(&metal("mirror", Rgb::splat(0.9), 0.0));
            self.writer.body("mirror", &mesh, silver);
        } else {
            let seed = texture::hash(near.to_bits(), low.to_bits());
            let paper = Material::lambertian("picture", Rgb::splat(0.9));
            let paper = self.writer.textured(&paper, &texture::screen(seed));
            self.writer.body("picture", &mesh, paper);
        }
    }
}
