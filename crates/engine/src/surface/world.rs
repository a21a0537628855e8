//! A scene as rays meet it: its triangles, what each reflects, emits and lets through, and what
//! surrounds them all.

use super::finish::{Finish, Finishes};
use super::layered::Layered;
use super::model::Parameters;
use super::point::Surface;
use crate::radiometry::Rgb;
use crate::rays::{Eye, Hit, Rays, Segment, Spot, unit_normal};
use crate::scene::emission_means::TexturedEmission;
use crate::scene::pyramid::Pyramids;
use crate::scene::{Background, Environment, Material, Scene};
use glam::{Vec2, Vec3};
use std::cell::Cell;
use std::sync::{Arc, OnceLock};

/// Cosine between normals that are the same but for rounding: .26°.
const SAME_NORMAL: f32 = 1.0 - 1e-5;

/// A scene for rays, with what its triangles reflect and emit.
#[derive(Clone)]
pub struct World {
    /// The scene.
    pub scene: Arc<Scene>,
    /// Its triangles.
    pub rays: Arc<Rays>,
    /// What surrounds it: sky and sun.
    pub environment: Arc<Environment>,
    /// What a camera sees beside its surfaces.
    pub background: Background,
    finishes: Arc<Finishes>,
    /// Whether light passes anything as clear, and whether it does so along a straight line.
    has_clear: bool,
    has_panes: bool,
    /// Whether anything lets light through diffusely.
    has_translucent: bool,
    has_normal_maps: bool,
    /// By material, whether it may mirror sharply.
    mirrors: Arc<[bool]>,
    /// Averages of its textures, once they have been asked for.
    pyramids: Arc<OnceLock<Arc<Pyramids>>>,
    /// Means of what its textures emit, once they have been asked for.
    textured_emission: Arc<OnceLock<Arc<TexturedEmission>>>,
}

impl World {
    /// Prepares a scene with nothing around it.
    #[cfg(test)]
    pub fn new(scene: Arc<Scene>) -> Self {
        Self::surrounded(scene, Arc::new(Environment::none()))
    }

    /// Prepares a scene in its surroundings.
    pub fn surrounded(scene: Arc<Scene>, environment: Arc<Environment>) -> Self {
        let rays = Arc::new(Rays::of(&scene));
        let finishes = Arc::new(Finishes::new(&scene, rays.scale()));
        let mirrors = scene.materials.iter().map(Material::casts_caustics).collect();
        let mut this = Self {
            rays,
            environment,
            background: Background::Sky,
            finishes,
            scene,
            has_clear: false,
            has_panes: false,
            has_translucent: false,
            has_normal_maps: false,
            mirrors,
            pyramids: Arc::default(),
            textured_emission: Arc::default(),
        };
        this.has_clear = this.finishes.all().iter().any(|finish| finish.clear.is_some());
        let materials = this.scene.materials.iter().zip(this.scene.used_materials());
        this.has_normal_maps =
            materials.into_iter().any(|(material, used)| used && material.normal_map.is_some());
        this.has_translucent = this.finishes.all().iter().any(|finish| finish.is_translucent);
        this.has_panes =
            this.has_clear && this.scene.unique_triangles().any(|triangle| this.is_pane(triangle));
        this
    }

    /// The same in other surroundings; what it is made of is shared.
    pub fn within(&self, environment: Arc<Environment>) -> Self {
        Self { environment, ..self.clone() }
    }

    /// The same, seen before a background.
    pub fn before(self, background: Background) -> Self {
        Self { background, ..self }
    }

    /// Radiance that a camera sees in the unit `direction` where there is no surface.
    pub fn beside_surfaces(&self, direction: Vec3) -> Rgb {
        self.background.radiance(&self.environment, direction)
    }

    /// Square metres of a square ray unit.
    pub fn square_metre(&self) -> f32 {
        (self.rays.scale() * self.rays.scale()).recip() as f32
    }

    /// Averages of the scene's textures.
    pub fn pyramids(&self) -> Arc<Pyramids> {
        self.pyramids.get_or_init(|| Arc::new(Pyramids::new(&self.scene))).clone()
    }

    /// Means of what triangles emit that have an emissive texture and an area.
    pub fn textured_emission(&self) -> Arc<TexturedEmission> {
        let is_textured =
            |material: &Material| material.emits() && material.emission_texture.is_some();
        let has_area = |triangle: &u32| {
            let (_, area) = self.rays.corners(&self.scene, *triangle);
            area > 0.0 && area.is_finite()
        };
        let find = || {
            let textured = self.scene.triangles_of(is_textured).filter(has_area).collect();
            Arc::new(TexturedEmission::new(&self.scene, textured))
        };
        self.textured_emission.get_or_init(find).clone()
    }

    /// Bytes that hierarchy, finishes and averages take.
    pub fn held_bytes(&self) -> u64 {
        let pyramids = self.pyramids.get().map_or(0, |_| Pyramids::needed_bytes(&self.scene));
        let emission = self.textured_emission.get().map_or(0, |all| all.held_bytes());
        self.rays.held_bytes() + self.finishes.held_bytes() + pyramids + emission
    }

    /// Bytes that [`Self::surrounded`] and the scene's lights take at their peak for so many triangles.
    pub fn needed_bytes(triangles: u64) -> u64 {
        // Finishes; emitters with their densities, picks and groups, if all shine.
        Rays::needed_bytes(triangles) + triangles * 300
    }

    /// Whether a triangle's back reflects and emits too.
    pub fn is_two_sided(&self, triangle: u32) -> bool {
        self.finishes.of(triangle).two_sided
    }

    /// Whether what a triangle reflects and emits varies over it.
    pub fn varies(&self, triangle: u32) -> bool {
        self.finishes.of(triangle).varies
    }

    /// Radiance that a triangle emits at barycentric (u, v).
    pub fn emission(&self, triangle: u32, u: f32, v: f32) -> Rgb {
        let finish = self.finishes.of(triangle);
        if finish.varies {
            self.scene.emission(&self.scene.triangle(triangle), u, v)
        } else {
            finish.emission
        }
    }

    /// What a triangle reflects and emits.
    pub fn finish(&self, triangle: u32) -> &Finish {
        self.finishes.of(triangle)
    }

    /// Material of a triangle.
    pub fn material(&self, triangle: u32) -> &Material {
        self.scene.material_of(triangle)
    }

    /// Radiance that a camera sees at barycentric coordinates of a triangle, of light that did not
    /// come from elsewhere: what it emits, and the colour of what is unlit.
    pub fn shine(&self, triangle: u32, at: Vec2) -> Rgb {
        let emission = self.emission(triangle, at.x, at.y);
        if !self.finishes.of(triangle).is_unlit {
            return emission;
        }
        let triangle = &self.scene.triangle(triangle);
        emission + self.scene.appearance(triangle, at.x, at.y).base_color
    }

    /// Unit normal between those of a triangle's vertices, on the side on which `normal` is the
    /// geometric one: the shading normal without a normal map.
    pub fn smooth_normal(&self, triangle: u32, at: Vec2, normal: Vec3, side: f32) -> Vec3 {
        if !self.finishes.of(triangle).is_bent {
            return normal;
        }
        let triangle = &self.scene.triangle(triangle);
        let given = self.scene.interpolate(triangle, at.x, at.y, |vertex| vertex.normal) * side;
        let given = given.normalize_or(normal);
        if given.dot(normal) > 0.0 { given } else { normal }
    }

    /// Whether a triangle has the same normal all over, normal maps aside: that of its plane, or close to it
    /// where a file has rounded normals.
    pub fn has_one_normal(&self, triangle: u32) -> bool {
        if !self.finishes.of(triangle).is_bent {
            return true;
        }
        let triangle = &self.scene.triangle(triangle);
        let given = |u, v| self.scene.interpolate(triangle, u, v, |vertex| vertex.normal);
        let corner = |u, v| given(u, v).normalize_or_zero();
        let first = corner(0.0, 0.0);
        [corner(1.0, 0.0), corner(0.0, 1.0)].iter().all(|other| is_same_normal(first, *other))
    }

    /// Unit shading normal at barycentric coordinates of a triangle, on the side on which `normal`
    /// is its geometric one; that one where the scene gives none above the surface.
    pub fn shading_normal(&self, triangle: u32, at: Vec2, normal: Vec3, side: f32) -> Vec3 {
        if !self.finishes.of(triangle).is_bent {
            return normal;
        }
        let triangle = &self.scene.triangle(triangle);
        let given = self.scene.shading_normal(triangle, at.x, at.y);
        given.map(|given| given * side).filter(|given| given.dot(normal) > 0.0).unwrap_or(normal)
    }

    /// A surface as it lies at other barycentric coordinates of its triangle, at that spot: with what it reflects, but
    /// turned as the normals are there.
    pub fn turned(&self, surface: &Surface, at: Vec2, spot: Spot) -> Surface {
        let (mut turned, side) = (*surface, if surface.back { -1.0 } else { 1.0 });
        turned.spot = spot;
        turned.shading_normal = self.shading_normal(surface.triangle, at, surface.normal, side);
        if let Parameters::Layered(layered) = &mut turned.parameters {
            self.lay(layered, (surface.triangle, at), surface.normal, side);
        }
        turned
    }

    /// Lets layers lie as they do at barycentric coordinates of a triangle, on the side on which
    /// `normal` is the geometric one.
    #[cold]
    #[inline(never)]
    pub(super) fn lay(&self, layered: &mut Layered, place: (u32, Vec2), normal: Vec3, side: f32) {
        let (triangle, at) = (&self.scene.triangle(place.0), place.1);
        let coated = layered.with_coat_normal(self.coat_normal(place, normal, side));
        *layered = coated.brushed(|along| self.scene.in_tangents(triangle, at, along));
    }

    /// Unit normal of a clear coat; see [`World::shading_normal`].
    fn coat_normal(&self, (triangle, at): (u32, Vec2), normal: Vec3, side: f32) -> Vec3 {
        if !self.finishes.of(triangle).is_bent {
            return normal;
        }
        let given = self.scene.coat_normal(&self.scene.triangle(triangle), at.x, at.y);
        given.map(|given| given * side).filter(|given| given.dot(normal) > 0.0).unwrap_or(normal)
    }

    /// The surface at a hit; `None` at a black back.
    pub fn surface(&self, hit: &Hit) -> Option<Surface> {
        let finish = self.finishes.of(hit.triangle);
        (!hit.back || finish.two_sided).then(|| self.surface_of(hit))
    }

    /// The surface that a ray along the unit `direction` meets first; `None` where there is
    /// nothing or a black back.
    pub fn meet(&self, eye: Eye, origin: Vec3, direction: Vec3) -> Option<(Surface, f32)> {
        let hit = self.rays.closest(eye, origin, direction)?;
        Some((self.met(&hit)?, hit.distance))
    }

    /// Whether a hit is of a black back.
    pub fn is_black(&self, hit: &Hit) -> bool {
        let finish = self.finishes.of(hit.triangle);
        hit.back && !finish.two_sided && finish.clear.is_none()
    }

    /// Whether light passes a triangle as clear, anywhere on it.
    #[inline]
    pub fn is_clear(&self, triangle: u32) -> bool {
        self.has_clear && self.finishes.of(triangle).clear.is_some()
    }

    /// Whether light may go through a triangle diffusely; see [`World::far_side`].
    #[inline]
    pub fn is_translucent(&self, triangle: u32) -> bool {
        self.has_translucent && self.finishes.of(triangle).is_translucent
    }

    /// Whether it may do so anywhere.
    pub fn has_translucent(&self) -> bool {
        self.has_translucent
    }

    /// Whether normal maps turn the shading normal anywhere.
    pub fn has_normal_maps(&self) -> bool {
        self.has_normal_maps
    }

    /// Whether a triangle may mirror sharply anywhere.
    #[inline]
    pub fn may_mirror(&self, triangle: u32) -> bool {
        self.mirrors[self.scene.triangle(triangle).material as usize]
    }

    /// Whether anything is clear.
    pub fn has_clear(&self) -> bool {
        self.has_clear
    }

    /// Whether light that a triangle lets through goes on along the same line; what has holes, too,
    /// does not count.
    pub fn is_pane(&self, triangle: u32) -> bool {
        let clear = &self.finishes.of(triangle).clear;
        clear.is_some_and(|clear| clear.is_straight()) && !self.rays.has_holes(triangle)
    }

    /// What arrives of light between two points (ray units), through panes that it passes on a
    /// straight line: 0 where something else is in between, 1 where nothing is.
    pub fn visibility(&self, from: Vec3, to: Vec3) -> Rgb {
        if !self.has_panes {
            return if self.rays.blocked(from, to, |_| false) { Rgb::ZERO } else { Rgb::ONE };
        }
        let passed = Cell::new(Rgb::ONE);
        let direction = (to - from).normalize_or_zero();
        let skip = |triangle: u32| {
            let is_pane = self.is_pane(triangle);
            if is_pane {
                passed.set(passed.get() * self.through_pane(triangle, from, direction));
            }
            is_pane
        };
        if self.rays.blocked(from, to, skip) { Rgb::ZERO } else { passed.get() }
    }

    /// The same between the ends of many segments, in their order; what `visible` held before goes.
    pub fn visibility_many(&self, segments: &[Segment], visible: &mut Vec<Rgb>) {
        visible.clear();
        visible.extend(segments.iter().map(|segment| self.visibility(segment.from, segment.to)));
    }

    /// What a pane lets through of a ray that crosses it.
    pub(super) fn through_pane(&self, index: u32, from: Vec3, direction: Vec3) -> Rgb {
        let finish = self.finishes.of(index);
        let (corners, _) = self.rays.corners(&self.scene, index);
        let normal = unit_normal(corners);
        let cosine = normal.dot(direction);
        let Some(mut clear) = finish.clear else { return Rgb::ZERO };
        if finish.varies {
            let [a, b, c] = corners;
            let crossed = from + direction * (normal.dot(a - from) / cosine);
            let twice = normal.dot((b - a).cross(c - a));
            let u = normal.dot((crossed - a).cross(c - a)) / twice;
            let v = normal.dot((b - a).cross(crossed - a)) / twice;
            let triangle = &self.scene.triangle(index);
            let Some(looking) = clear.looking(&self.scene.appearance(triangle, u, v)) else {
                return Rgb::ZERO;
            };
            clear = looking;
        }
        clear.straight(cosine)
    }

    /// The surface of a side of a triangle at barycentric (u, v).
    pub fn at(&self, triangle: u32, [u, v]: [f32; 2], back: bool) -> Surface {
        let (corners, _) = self.rays.corners(&self.scene, triangle);
        let spot = Spot::new(corners, unit_normal(corners), u, v);
        self.surface_at(triangle, Vec2::new(u, v), spot, if back { -1.0 } else { 1.0 })
    }

    /// The surface at a hit; `None` at a black back that lets nothing through.
    pub fn met(&self, hit: &Hit) -> Option<Surface> {
        (!self.is_black(hit)).then(|| self.surface_of(hit))
    }

    /// The surface at a hit, black or not.
    pub fn surface_of(&self, hit: &Hit) -> Surface {
        let side = if hit.back { -1.0 } else { 1.0 };
        self.surface_at(hit.triangle, Vec2::new(hit.u, hit.v), self.rays.spot(hit), side)
    }

    /// The surface at barycentric coordinates of a triangle, which lie at `spot`; `side` is −1
    /// for its back.
    pub fn surface_at(&self, index: u32, at: Vec2, spot: Spot, side: f32) -> Surface {
        let (finish, back) = (self.finishes.of(index), side < 0.0);
        let triangle = &self.scene.triangle(index);
        let normal = spot.normal * side;
        let (mut parameters, mut emission, mut clear) =
            (finish.parameters, finish.emission, finish.clear);
        if finish.varies {
            let material = &self.scene.materials[triangle.material as usize];
            let appearance = self.scene.appearance(triangle, at.x, at.y);
            parameters = Parameters::new(material, &appearance);
            emission = self.scene.emission(triangle, at.x, at.y);
            clear = clear.and_then(|clear| clear.looking(&appearance));
        }
        let all_clear = clear.is_some_and(|clear| clear.share >= 1.0);
        if all_clear || (back && !finish.two_sided) {
            // Of a back that light gets out of, what is not clear is black.
            parameters = Parameters::BLACK;
        }
        if back && !finish.two_sided {
            emission = Rgb::ZERO;
        }
        let shading_normal = self.shading_normal(index, at, normal, side);
        if let Parameters::Layered(layered) = &mut parameters {
            self.lay(layered, (index, at), normal, side);
        }
        let at = at.to_array();
        Surface {
            triangle: index,
            at,
            back,
            spot,
            normal,
            shading_normal,
            parameters,
            emission,
            clear,
        }
    }
}

/// Whether two unit normals are the same but for rounding.
pub fn is_same_normal(one: Vec3, other: Vec3) -> bool {
    one.dot(other) > SAME_NORMAL
}
