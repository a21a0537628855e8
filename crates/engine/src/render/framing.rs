//! A camera for scenes that have none: inside, at eye height, where the scene encloses a room that has
//! light in it or no outside; else in front of it, so far away that all of it fits the picture.

use crate::rays::{Eye, Rays};
use crate::scene::{Camera, PunctualLight, Scene};
use glam::{Vec2, Vec3};
use std::f32::consts::{PI, TAU};

/// Vertical field of view of a camera in front of a scene, radians.
const OUTER_YFOV: f32 = 45.0 / 180.0 * PI;
/// From where it looks: the front (glTF's is +Z), from the right and from above, far enough to both
/// that three faces of a cube are seen.
const FRONT: Vec3 = Vec3::new(0.55, 0.5, 1.0);
/// From where it looks at what lies flat: a floor, a terrain.
const ABOVE: Vec3 = Vec3::new(0.45, 0.9, 0.8);
/// A scene lies flat if its height is less than this share of its lesser extent across.
const FLAT: f32 = 0.15;
/// Height from which it looks into an opening, as a share of the way to the side.
const ABOVE_OPENING: f32 = 0.1;
/// Share of the half picture that the scene fills along the axis that it fills more.
const FILLED: f32 = 0.94;
/// Field of view along a room's picture's longer side, radians.
const INNER_FOV: f32 = 75.0 / 180.0 * PI;
/// Directions in which a place looks for walls.
const DIRECTIONS: u32 = 128;
/// A place is in a room if this share of the directions meets the front of a surface.
const ENCLOSED: f32 = 0.92;
/// A place is in a niche, a room with one side open, if this share does.
const NICHE: f32 = 0.6;
/// The directions of a niche's opening have a mean at least so long.
const OPENING_LENGTH: f32 = 0.6;
/// A scene is a room if so many of its places are in one.
const ROOM: f32 = 0.5;
/// Where places are, as shares of the scene's width and depth.
const PLACES: [f32; 5] = [0.1, 0.3, 0.5, 0.7, 0.9];
/// Azimuths in which a place may look, and the heights (tangents) of the rays that judge them.
const AZIMUTHS: usize = 24;
const HEIGHTS: [f32; 3] = [-0.3, 0.0, 0.3];
/// Height of a person's eyes, metres.
const EYE_HEIGHT: f32 = 1.6;
/// Heights of rooms that persons walk in, metres.
const HUMAN: std::ops::RangeInclusive<f32> = 1.9..=30.0;
/// Height of the eyes in a room of any other size, as a share of its height.
const EYE_SHARE: f32 = 0.6;
/// A room without lights is one if at least this share of the directions from its places leads
/// outside; a solid thing has gaps inside, too, but no daylight in them.
const DAYLIGHT: f32 = 0.002;

/// A camera for a scene that has none and a picture of that width over height, and what it does, for
/// a warning.
pub fn camera(scene: &Scene, aspect: f32) -> (Camera, &'static str) {
    let (low, high) = scene.bounds().unwrap_or((Vec3::splat(-1.0), Vec3::ONE));
    let walls = Walls { scene, rays: Rays::new(scene), low, high };
    if let Some(camera) = walls.inner_camera(aspect) {
        return (camera, "one that stands in the room, at eye height,");
    }
    let size = high - low;
    let from = if size.y < FLAT * size.x.min(size.z) { ABOVE } else { FRONT };
    let from = walls.opening().unwrap_or(from);
    let camera = if scene.triangle_count() == 0 {
        frame((low, high), [low, high].into_iter(), from, aspect)
    } else {
        frame((low, high), points(scene), from, aspect)
    };
    (camera, "one that frames it")
}

/// Points that have all of the scene between them: its vertices, and the corners of boxes around meshes
/// that are there many times.
fn points(scene: &Scene) -> impl Iterator<Item = Vec3> {
    let shared = scene.instances.all().iter().flat_map(|instance| {
        let (low, high) = instance.box_around(scene.instances.shape_of(instance));
        (0..8).map(move |corner| {
            let is_high = [1, 2, 4].map(|bit| corner & bit != 0);
            Vec3::from_array(std::array::from_fn(|k| if is_high[k] { high[k] } else { low[k] }))
        })
    });
    scene.vertices.iter().map(|vertex| vertex.position).chain(shared)
}

/// A camera that looks from the direction `from` at the middle of a box and has all of the points in
/// it in view, as near as that allows.
fn frame(
    (low, high): (Vec3, Vec3),
    points: impl Iterator<Item = Vec3>,
    from: Vec3,
    aspect: f32,
) -> Camera {
    let (center, half) = (0.5 * low + 0.5 * high, (0.5 * high - 0.5 * low).max(Vec3::splat(1e-9)));
    let backward = from.normalize();
    let right = Vec3::Y.cross(backward).normalize();
    let up = backward.cross(right);
    let tangent = (0.5 * OUTER_YFOV).tan() * FILLED;
    let tangents = Vec2::new(tangent * aspect, tangent);
    // A point p (across, away from the camera) is in view from the distance D with the camera moved
    // by s to the side where |p.across − s| ≤ t (D + p.away).
    let mut most = [Vec2::splat(f32::NEG_INFINITY); 2];
    let mut nearest = f32::INFINITY;
    for point in points {
        let own = point - center;
        let across = Vec2::new(own.dot(right), own.dot(up));
        let away = -own.dot(backward);
        most[0] = most[0].max(across - tangents * away);
        most[1] = most[1].max(-across - tangents * away);
        nearest = nearest.min(away);
    }
    let fitting = (0.5 * (most[0] + most[1]) / tangents).max_element();
    let distance = fitting.max(0.05 * half.length() - nearest);
    let moved = 0.5 * (most[0] - most[1]);
    let target = center + right * moved.x + up * moved.y;
    Camera::look_at("framing", target + backward * distance, target, Vec3::Y, OUTER_YFOV)
}

/// What a scene looks like from inside.
struct Walls<'a> {
    scene: &'a Scene,
    rays: Rays,
    low: Vec3,
    high: Vec3,
}

/// Where a camera may stand, and where it looks.
struct Stand {
    eye: Vec3,
    direction: Vec3,
    /// How far it sees: the geometric mean of the distances.
    depth: f32,
}

impl Walls<'_> {
    /// Distance, metres, to the front of a surface that a ray from a place in the world meets first;
    /// `None` where it meets a back or nothing.
    fn distance(&self, from: Vec3, direction: Vec3) -> Option<f32> {
        let hit = self.rays.closest(Eye::Light, self.rays.place(from), direction)?;
        (!hit.back).then(|| (f64::from(hit.distance) / self.rays.scale()) as f32)
    }

    /// Share of all directions that meet the front of a surface, and the mean of those that do not.
    fn enclosure(&self, place: Vec3) -> (f32, Vec3) {
        let (mut met, mut open) = (0, Vec3::ZERO);
        for number in 0..DIRECTIONS {
            let direction = on_sphere(number);
            match self.distance(place, direction) {
                Some(_) => met += 1,
                None => open += direction,
            }
        }
        (met as f32 / DIRECTIONS as f32, open / (DIRECTIONS - met).max(1) as f32)
    }

    /// Share of all directions from a place that lead outside, be it through glass.
    fn outlook(&self, place: Vec3) -> f32 {
        let is_clear = |triangle: u32| {
            let triangle = self.scene.triangle(triangle);
            self.scene.materials[triangle.material as usize].transmission > 0.0
        };
        let out = (0..DIRECTIONS).filter(|number| {
            let hit = self.rays.closest(Eye::Light, self.rays.place(place), on_sphere(*number));
            hit.is_none_or(|hit| is_clear(hit.triangle))
        });
        out.count() as f32 / DIRECTIONS as f32
    }

    /// Whether most of what one meets from outside are black backs: walls that are there for who is
    /// inside alone.
    fn is_shell(&self) -> bool {
        let (middle, reach) = (self.place(Vec3::splat(0.5)), (self.high - self.low).length());
        let (mut met, mut black) = (0, 0);
        for number in 0..DIRECTIONS {
            let towards = on_sphere(number);
            let from = self.rays.place(middle - reach * towards);
            let Some(hit) = self.rays.closest(Eye::Light, from, towards) else { continue };
            let triangle = self.scene.triangle(hit.triangle);
            met += 1;
            black += u32::from(
                hit.back && !self.scene.materials[triangle.material as usize].double_sided,
            );
        }
        2 * black > met
    }

    /// Whether there is light inside, where so large a share of the directions leads outside.
    fn is_lit(&self, outlook: f32) -> bool {
        let scene = self.scene;
        let is_walked_in = self.high.y - self.low.y >= *HUMAN.start();
        (is_walked_in && outlook >= DAYLIGHT)
            || scene.lights.iter().any(PunctualLight::shines)
            || scene.emissive_triangles() > 0
            || scene.has_unlit()
    }

    fn place(&self, share: Vec3) -> Vec3 {
        self.low + (self.high - self.low) * share
    }

    /// A camera in the room that the scene is; `None` where it is none.
    fn inner_camera(&self, aspect: f32) -> Option<Camera> {
        if self.rays.is_empty() {
            return None;
        }
        let longer = (0.5 * INNER_FOV).tan();
        let half = Vec2::new(longer * aspect.min(1.0), longer / aspect.max(1.0));
        let (mut enclosed, mut outlook) = (0, 0.0);
        let mut best: Option<Stand> = None;
        for x in PLACES {
            for z in PLACES {
                let place = self.place(Vec3::new(x, 0.5, z));
                if self.enclosure(place).0 < ENCLOSED {
                    continue;
                }
                enclosed += 1;
                outlook += self.outlook(place);
                let Some(eye) = self.eye(place) else { continue };
                let stand = self.widest(eye, half.x);
                if best.as_ref().is_none_or(|best| stand.depth > best.depth) {
                    best = Some(stand);
                }
            }
        }
        let share = enclosed as f32 / (PLACES.len() * PLACES.len()) as f32;
        let is_room = share >= ROOM && (self.is_lit(outlook / enclosed as f32) || self.is_shell());
        let Stand { eye, direction, depth } = best.filter(|_| is_room)?;
        let yfov = 2.0 * half.y.atan();
        Some(Camera::look_at("inside", eye, eye + direction * depth, Vec3::Y, yfov))
    }

    /// Where the eyes of who stands below or above a place in a room are.
    fn eye(&self, place: Vec3) -> Option<Vec3> {
        let floor = place.y - self.distance(place, Vec3::NEG_Y)?;
        let height = place.y + self.distance(place, Vec3::Y)? - floor;
        let eyes = if HUMAN.contains(&height) { EYE_HEIGHT } else { EYE_SHARE * height };
        let eye = place.with_y(floor + eyes);
        (self.enclosure(eye).0 >= ENCLOSED).then_some(eye)
    }

    /// The horizontal direction in which a camera of so wide a view, the tangent of half its angle,
    /// sees farthest.
    fn widest(&self, eye: Vec3, half_width: f32) -> Stand {
        let direction = |azimuth: usize| {
            let (sin, cos) = (TAU * azimuth as f32 / AZIMUTHS as f32).sin_cos();
            Vec3::new(sin, 0.0, -cos)
        };
        let least = 1e-6 * (self.high - self.low).length().max(f32::MIN_POSITIVE);
        let logarithm = |azimuth: usize| {
            let of = |height: f32| {
                let towards = (direction(azimuth) + height * Vec3::Y).normalize();
                self.distance(eye, towards).unwrap_or(least).max(least).ln()
            };
            HEIGHTS.into_iter().map(of).sum::<f32>() / HEIGHTS.len() as f32
        };
        let logarithms: [f32; AZIMUTHS] = std::array::from_fn(logarithm);
        let reach = (half_width.atan() / TAU * AZIMUTHS as f32) as usize;
        let seen = |azimuth: usize| {
            let all = AZIMUTHS - reach + azimuth..=AZIMUTHS + reach + azimuth;
            all.map(|azimuth| logarithms[azimuth % AZIMUTHS]).sum::<f32>() / (2 * reach + 1) as f32
        };
        let (azimuth, depth) = (0..AZIMUTHS)
            .map(|azimuth| (azimuth, seen(azimuth)))
            .fold((0, f32::NEG_INFINITY), |best, own| if own.1 > best.1 { own } else { best });
        Stand { eye, direction: direction(azimuth), depth: depth.exp() }
    }

    /// From where one looks into a scene that is a room with one side open; `None` where it is none,
    /// or is open above or below.
    fn opening(&self) -> Option<Vec3> {
        if self.rays.is_empty() {
            return None;
        }
        let (share, open) = self.enclosure(self.place(Vec3::splat(0.5)));
        let aside = open.with_y(0.0);
        let is_one = (NICHE..1.0).contains(&share) && aside.length() > OPENING_LENGTH;
        is_one.then(|| aside.normalize() + ABOVE_OPENING * Vec3::Y)
    }
}

/// One of the well-spread directions (a Fibonacci lattice on the sphere).
fn on_sphere(number: u32) -> Vec3 {
    const GOLDEN_ANGLE: f32 = 2.399_963_2;
    let y = 1.0 - (2 * number + 1) as f32 / DIRECTIONS as f32;
    let (sin, cos) = (GOLDEN_ANGLE * number as f32).sin_cos();
    let across = (1.0 - y * y).sqrt();
    Vec3::new(across * cos, y, across * sin)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::radiometry::Rgb;
    use crate::scene::gltf::{ImportLimits, Resources, import};
    use crate::scene::{Material, Triangle, Vertex, made};

    const ASPECTS: [f32; 3] = [0.5, 1.0, 2.0];

    /// Adds an axis-parallel box, seen from inside or outside.
    fn add_box(scene: &mut Scene, low: Vec3, high: Vec3, inward: bool) {
        if scene.materials.is_empty() {
            scene.materials.push(Material::lambertian("grey", Rgb::splat(0.5)));
        }
        let size = high - low;
        let (x, y, z) = (Vec3::X * size.x, Vec3::Y * size.y, Vec3::Z * size.z);
        let faces = [
            (low, x, y),
            (low, y, z),
            (low, z, x),
            (low + z, y, x),
            (low + x, z, y),
            (low + y, x, z),
        ];
        for (corner, u, v) in faces {
            let (u, v) = if inward { (u, v) } else { (v, u) };
            let normal = u.cross(v).normalize();
            let first = scene.vertices.len() as u32;
            for position in [corner, corner + u, corner + u + v, corner + v] {
                scene.vertices.push(Vertex::new(position, normal));
            }
            for vertices in [[first, first + 1, first + 2], [first, first + 2, first + 3]] {
                scene.triangles.push(Triangle { vertices, material: 0 });
            }
        }
    }

    fn room(low: Vec3, high: Vec3) -> Scene {
        let mut scene = Scene::default();
        add_box(&mut scene, low, high, true);
        scene
    }

    /// A room with a lamp under the middle of its ceiling.
    fn lit_room(low: Vec3, high: Vec3) -> Scene {
        let mut scene = room(low, high);
        let mut lamp = Material::lambertian("lamp", Rgb::ZERO);
        lamp.emission = Rgb::ONE;
        scene.materials.push(lamp);
        let first = scene.vertices.len() as u32;
        let under = (0.5 * (low + high)).with_y(high.y - 0.01 * (high.y - low.y));
        let (x, z) = (0.01 * Vec3::X * (high.x - low.x), 0.01 * Vec3::Z * (high.z - low.z));
        for position in [under, under + x, under + z] {
            scene.vertices.push(Vertex::new(position, Vec3::NEG_Y));
        }
        let vertices = [first, first + 1, first + 2];
        scene.triangles.push(Triangle { vertices, material: 1 });
        scene
    }

    fn eye(camera: &Camera) -> Vec3 {
        camera.to_world.w_axis.truncate()
    }

    fn forward(camera: &Camera) -> Vec3 {
        -camera.to_world.z_axis.truncate()
    }

    /// Picture coordinates, [−1, 1] inside, of a point; `None` behind the camera.
    fn project(camera: &Camera, aspect: f32, point: Vec3) -> Option<Vec2> {
        let own = camera.to_world.inverse().transform_point3(point);
        let crate::scene::Projection::Perspective { yfov } = camera.projection else { return None };
        let tangent = (0.5 * yfov).tan();
        let at = Vec2::new(own.x / aspect, own.y) / (tangent * -own.z);
        (own.z < 0.0).then_some(at)
    }

    /// Least and greatest picture coordinates of all vertices.
    fn extent(scene: &Scene, camera: &Camera, aspect: f32) -> (Vec2, Vec2) {
        let all = scene.vertices.iter().map(|v| project(camera, aspect, v.position).expect("seen"));
        let none = (Vec2::INFINITY, Vec2::NEG_INFINITY);
        all.fold(none, |(low, high), at| (low.min(at), high.max(at)))
    }

    /// A duck: a body, and a head on one side of it.
    fn duck() -> Scene {
        let mut scene = Scene::default();
        add_box(&mut scene, Vec3::new(-0.7, 0.1, -0.4), Vec3::new(0.5, 0.9, 0.4), false);
        add_box(&mut scene, Vec3::new(0.3, 0.9, -0.3), Vec3::new(0.96, 1.6, 0.3), false);
        scene
    }

    #[test]
    fn objects_are_seen_whole_and_fill_the_picture() {
        for (offset, scale) in [(0.0, 1.0), (300.0, 7.0), (0.0, 1e-4)] {
            let mut scene = duck();
            for vertex in &mut scene.vertices {
                vertex.position = vertex.position * scale + offset;
            }
            for aspect in ASPECTS {
                let (camera, what) = camera(&scene, aspect);
                assert!(what.contains("frames"));
                let (low, high) = extent(&scene, &camera, aspect);
                let filled = 0.5 * (high - low);
                println!("{aspect}: {low} to {high}");
                assert!(low.min_element() > -1.0 && high.max_element() < 1.0, "{low} {high}");
                assert!(filled.max_element() > 0.85, "{aspect}: {filled}");
                // From the front and slightly above.
                let forward = forward(&camera);
                assert!(forward.z < -0.8 && forward.y < -0.1, "{forward}");
            }
        }
    }

    /// Of a cube one sees three faces, and of a floor more than its edge.
    #[test]
    fn tops_and_sides_are_seen() {
        let mut cube = Scene::default();
        add_box(&mut cube, Vec3::splat(-1.0), Vec3::ONE, false);
        let mut floor = Scene::default();
        add_box(&mut floor, Vec3::new(-3.0, 0.0, -2.0), Vec3::new(3.0, 0.1, 2.0), false);
        for aspect in ASPECTS {
            let (of_cube, _) = camera(&cube, aspect);
            assert!(eye(&of_cube).min_element() > 1.05, "{}", eye(&of_cube));
            let (of_floor, _) = camera(&floor, aspect);
            let forward = forward(&of_floor);
            assert!(forward.y < -0.6 && forward.y > -0.8 && forward.z < -0.5, "{forward}");
            let (low, high) = extent(&floor, &of_floor, aspect);
            assert!(low.min_element() > -1.0 && high.max_element() < 1.0, "{low} {high}");
        }
    }

    #[test]
    fn nothing_and_what_is_flat_are_framed_too() {
        let (camera_of_none, _) = camera(&Scene::default(), 1.0);
        assert!(camera_of_none.to_world.is_finite());
        for size in [Vec3::new(1.0, 0.0, 1.0), Vec3::new(0.0, 1.0, 1.0), Vec3::new(2.0, 1.0, 0.0)] {
            let scene = room(Vec3::ZERO, size);
            let (camera, _) = camera(&scene, 1.5);
            let (low, high) = extent(&scene, &camera, 1.5);
            assert!(low.min_element() > -1.0 && high.max_element() < 1.0, "{low} {high}");
        }
    }

    /// The inside of a room of human size, and of one that is larger or smaller than any.
    #[test]
    fn rooms_are_seen_from_inside_at_eye_height() {
        for (size, height) in [
            (Vec3::new(4.0, 2.5, 9.0), 1.6),
            (Vec3::new(30.0, 20.0, 12.0), 1.6),
            (Vec3::new(400.0, 250.0, 900.0), 150.0),
            (Vec3::new(0.4, 0.25, 0.9), 0.15),
        ] {
            let low = Vec3::new(-1.0, 3.0, 2.0);
            let scene = lit_room(low, low + size);
            for aspect in ASPECTS {
                let (camera, what) = camera(&scene, aspect);
                assert!(what.contains("room"), "{size}");
                let at = eye(&camera) - low;
                assert!((at.y / height - 1.0).abs() < 1e-3, "{size}: {at}");
                assert!(at.cmpgt(Vec3::ZERO).all() && at.cmplt(size).all(), "{at}");
                // Along the room, from one end: most of it is in front of the camera.
                let longest = if size.x > size.z { Vec3::X } else { Vec3::Z };
                let ahead = at.dot(longest) / size.dot(longest);
                let sees = if forward(&camera).dot(longest) > 0.0 { 1.0 - ahead } else { ahead };
                assert!(sees > 0.6 && forward(&camera).dot(longest).abs() > 0.6, "{size}: {sees}");
                assert!(forward(&camera).y.abs() < 1e-5);
            }
        }
    }

    /// Furniture is no obstacle, and a solid thing is no room, even where both its sides are there.
    #[test]
    fn furniture_stands_in_rooms_and_solids_are_none() {
        let mut scene = lit_room(Vec3::ZERO, Vec3::new(6.0, 2.6, 4.0));
        add_box(&mut scene, Vec3::new(2.0, 0.0, 1.0), Vec3::new(3.0, 0.8, 2.5), false);
        add_box(&mut scene, Vec3::new(5.0, 0.0, 0.1), Vec3::new(5.9, 2.2, 0.6), false);
        let (camera_inside, what) = camera(&scene, 1.0);
        let at = eye(&camera_inside);
        assert!(what.contains("room") && at.y < 2.6, "{at}");
        assert!(
            !(at.cmpgt(Vec3::new(5.0, 0.0, 0.1)).all() && at.cmplt(Vec3::new(5.9, 2.2, 0.6)).all())
        );
        let mut solid = duck();
        solid.materials[0].double_sided = true;
        assert!(camera(&solid, 1.0).1.contains("frames"));
    }

    /// Inside what is sealed and dark there is nothing to be seen, be it a crate both of whose sides
    /// are there; a window of air or of glass lets one see.
    #[test]
    fn rooms_without_light_are_seen_from_outside() {
        let (low, high) = (Vec3::ZERO, Vec3::new(6.0, 2.6, 4.0));
        let frames = |scene: &Scene| camera(scene, 1.0).1.contains("frames");
        let room = |low, high| {
            let mut room = room(low, high);
            // Walls without an outside show nothing from there: these are always seen from inside.
            assert!(!frames(&room));
            room.materials[0].double_sided = true;
            room
        };
        assert!(!frames(&lit_room(low, high)));
        assert!(frames(&room(low, high)));
        let mut crate_of_wood = Scene::default();
        add_box(&mut crate_of_wood, low, high, false);
        crate_of_wood.materials[0].double_sided = true;
        assert!(frames(&crate_of_wood));
        // A triangle of one end wall is missing.
        let end = |scene: &Scene| {
            let across = |t: &Triangle| t.vertices.map(|v| scene.vertices[v as usize].position.x);
            scene.triangles.iter().position(|t| across(t) == [0.0; 3]).expect("an end wall")
        };
        let mut with_window = room(low, high);
        let window = end(&with_window);
        let missing = with_window.triangles.remove(window);
        assert!(!frames(&with_window));
        // The same at the size of a toy is a box with a hole.
        with_window.vertices.iter_mut().for_each(|vertex| vertex.position *= 0.1);
        assert!(frames(&with_window));
        let mut with_glass = room(low, high);
        let mut glass = Material::lambertian("glass", Rgb::ONE);
        glass.transmission = 1.0;
        with_glass.materials.push(glass);
        with_glass.triangles[window] = Triangle { material: 1, ..missing };
        assert!(!frames(&with_glass));
        // What needs no light is seen without.
        let mut baked = room(low, high);
        baked.materials[0].unlit = true;
        assert!(!frames(&baked));
    }

    /// The Cornell box is open in front: the camera stands there and sees all walls.
    #[test]
    fn open_boxes_are_looked_into() {
        let glb = made::cornell();
        let mut scene = import(&glb, &Resources::default(), &ImportLimits::default()).unwrap();
        scene.cameras.clear();
        for aspect in ASPECTS {
            let (camera, _) = camera(&scene, aspect);
            let (low, high) = extent(&scene, &camera, aspect);
            assert!(low.min_element() > -1.0 && high.max_element() < 1.0, "{low} {high}");
            let (forward, bounds) = (forward(&camera), scene.bounds().unwrap());
            assert!(forward.z.abs() > 0.95, "{forward}");
            // Side walls, floor and ceiling are not hidden, in front of the blocks.
            let rays = Rays::new(&scene);
            let middle = 0.5 * (bounds.0 + bounds.1);
            let towards_opening = Vec3::Z * -0.42 * forward.z.signum();
            for wall in [Vec3::X, -Vec3::X, Vec3::Y, -Vec3::Y] {
                let at = middle + (0.45 * wall + towards_opening) * (bounds.1 - bounds.0);
                assert!(
                    !rays.blocked(rays.place(eye(&camera)), rays.place(at), |_| false),
                    "{wall}"
                );
            }
        }
    }
}
