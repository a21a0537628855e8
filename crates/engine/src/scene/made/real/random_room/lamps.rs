//! What lights a room.

use super::super::super::mesh::{Mesh, spline};
use super::super::parts::{lamp, panel};
use super::Making;
use crate::radiometry::Rgb;
use crate::scene::{LightKind, Material, PunctualLight};
use glam::Vec3;

impl Making {
    /// One to three lamps; none in some rooms that have a window.
    pub(super) fn lamps(&mut self, is_needed: bool) {
        if !is_needed && self.chance.unit() < 0.5 {
            return;
        }
        let count = 1 + (3.0 * self.chance.unit()) as u32;
        for index in 0..count {
            let along = (index as f32 + self.chance.between(0.3, 0.7)) / count as f32;
            let across = self.chance.between(0.2, 0.8);
            let place = Vec3::new(across * self.size.x, self.size.y, along * self.size.z);
            let tint = Rgb::new(1.0, self.chance.between(0.7, 1.0), self.chance.between(0.4, 1.0));
            match self.chance.unit() {
                kind if kind < 0.4 => self.panel(place, tint),
                kind if kind < 0.65 => self.bulb(place, tint),
                kind if kind < 0.85 => self.shaded(place, tint),
                _ if self.has_mirror => self.panel(place, tint),
                _ => self.point(place, tint),
            }
        }
    }

    /// A square under the ceiling.
    fn panel(&mut self, place: Vec3, tint: Rgb) {
        let half = self.chance.between(0.1, 0.5);
        let corner = place + Vec3::new(-half, -0.003, -half);
        let quad = panel(corner, 2.0 * half * Vec3::X, 2.0 * half * Vec3::Z);
        let power = self.chance.between(3.0, 9.0);
        lamp(&mut self.writer, &quad, tint * (power / (half * half)));
    }

    /// A ball that hangs from the ceiling.
    fn bulb(&mut self, place: Vec3, tint: Rgb) {
        let radius = self.chance.between(0.05, 0.18);
        let at = place - self.chance.between(0.3, 0.9) * Vec3::Y;
        let intensity = self.chance.between(0.8, 2.0);
        self.shining_ball(at, radius, tint * (intensity / (radius * radius)));
    }

    fn shining_ball(&mut self, at: Vec3, radius: f32, emission: Rgb) {
        let dark = Material::lambertian("bulb", Rgb::ZERO);
        let glow = self.writer.material(&Material { emission, ..dark });
        self.writer.body("bulb", &Mesh::sphere(radius, 10, 20).at(at), glow);
    }

    /// A ball in a tube that is open above and below: what it lights is lit through the ends and by
    /// the tube's inside.
    fn shaded(&mut self, place: Vec3, tint: Rgb) {
        let radius = self.chance.between(0.12, 0.3);
        let (outer, inner) = (f64::from(radius), f64::from(radius) - 0.006);
        let height = f64::from(self.chance.between(1.2, 2.2)) * outer;
        let profile = [
            [outer, 0.0],
            [outer, height],
            [0.5 * (outer + inner), height + 0.003],
            [inner, height],
            [inner, 0.0],
            [0.5 * (outer + inner), -0.003],
            [outer, 0.0],
        ];
        let drop = self.chance.between(0.2, 0.7) + height as f32;
        let at = place - drop * Vec3::Y;
        let cloth = Material::lambertian("shade", self.chance.color(0.4, 0.85));
        let cloth = self.writer.material(&cloth);
        self.writer.body("shade", &Mesh::revolved(&spline(&profile, 1), 40).at(at), cloth);
        let middle = at + 0.5 * height as f32 * Vec3::Y;
        let bulb = 0.35 * radius;
        let emission = tint * (self.chance.between(1.5, 4.0) / (bulb * bulb));
        self.shining_ball(middle, bulb, emission);
    }

    /// A light without extent.
    fn point(&mut self, place: Vec3, tint: Rgb) {
        let spot = LightKind::Spot { inner_cone: 0.4, outer_cone: 0.9 };
        let kind = if self.chance.unit() < 0.5 { LightKind::Point } else { spot };
        let intensity = tint * self.chance.between(3.0, 8.0);
        self.writer.light(&PunctualLight {
            name: "point".into(),
            kind,
            position: place - self.chance.between(0.2, 0.6) * Vec3::Y,
            direction: Vec3::NEG_Y,
            intensity,
            range: None,
        });
    }
}
