//! The camera as a pixel grid: which facets it can see, as triangles over its pixels.

use super::pixel_box::PixelBox;
use crate::hemicube::item;
use crate::patches::{Cut, Facet, FacetIndex, NO_PATCH, PatchedScene};
use crate::raster::{PixelPlane, PixelTriangle, centre_range, exact_edge_planes};
use crate::scene::{Camera, Projection};
use glam::{DVec2, DVec3, Vec2, Vec3};
use rayon::prelude::*;

/// Facets that a thread sets up at a time.
const CHUNK: usize = 4096;

/// Facets in front of a camera, set up for its pixel grid.
pub struct View {
    /// Columns.
    pub width: u32,
    /// Rows, the first at the top.
    pub height: u32,
    frame: Frame,
    triangles: Vec<ViewTriangle>,
    /// Boxes of the triangles of a crowd, which are mostly small.
    boxes: Vec<PixelBox>,
}

/// A facet over the pixel grid, for samples at pixel centres.
pub struct ViewTriangle {
    edges: [PixelPlane; 3],
    nearness: PixelPlane,
    rows: (u32, u32),
    code: u32,
}

impl ViewTriangle {
    /// The triangle for samples that lie `offset` pixels off the centres.
    #[inline(always)]
    pub fn moved(&self, offset: Vec2) -> PixelTriangle {
        PixelTriangle {
            edges: self.edges.map(|edge| moved(edge, offset)),
            nearness: moved(self.nearness, offset),
            rows: self.rows,
            code: self.code,
        }
    }
}

#[inline(always)]
fn moved(plane: PixelPlane, offset: Vec2) -> PixelPlane {
    let constant = plane.constant + plane.per_column * offset.x + plane.per_row * offset.y;
    PixelPlane { constant, ..plane }
}

/// World to homogeneous picture coordinates: x and y over z in [−1, 1] inside the picture.
#[derive(Clone, Copy)]
pub struct Frame {
    eye: Vec3,
    right: Vec3,
    up: Vec3,
    forward: Vec3,
    /// tan of half the field of view, or half the extent, per axis.
    half: Vec2,
    perspective: bool,
}

impl Frame {
    /// The frame of a camera's picture of `width` × `height` pixels.
    pub fn new(camera: &Camera, width: u32, height: u32) -> Self {
        let axis = |v: glam::Vec4| v.truncate().normalize_or_zero();
        let m = camera.to_world;
        let (half_height, perspective) = match camera.projection {
            Projection::Perspective { yfov } => ((0.5 * yfov).tan(), true),
            Projection::Orthographic { ymag } => (ymag, false),
        };
        let aspect = width as f32 / height as f32;
        Self {
            eye: m.w_axis.truncate(),
            right: axis(m.x_axis),
            up: axis(m.y_axis),
            forward: -axis(m.z_axis),
            half: Vec2::new(half_height * aspect, half_height),
            perspective,
        }
    }

    /// Where the ray through picture coordinates (x right, y up, [−1, 1] each) starts, in world
    /// space, and its unit direction.
    pub fn ray(&self, at: Vec2) -> (Vec3, Vec3) {
        let across = self.right * (at.x * self.half.x) + self.up * (at.y * self.half.y);
        if self.perspective {
            (self.eye, (self.forward + across).normalize())
        } else {
            (self.eye + across, self.forward)
        }
    }

    /// Unit direction from a point to the camera.
    pub fn towards_eye(&self, point: Vec3) -> Vec3 {
        if self.perspective {
            (self.eye - point).normalize_or(-self.forward)
        } else {
            -self.forward
        }
    }

    /// Side of a pixel at a point's depth, for a picture of so many rows.
    pub fn footprint(&self, point: Vec3, height: u32) -> f32 {
        let depth = if self.perspective { self.project(point).1.abs() } else { 1.0 };
        depth * 2.0 * self.half.y / height as f32
    }

    /// Steps from a point to those at its depth that the pixels to the right and below show, and between the unit
    /// directions to these, about, for a picture of so many rows.
    pub fn pixel_steps(&self, point: Vec3, height: u32) -> [[Vec3; 2]; 2] {
        let side = 2.0 * self.half.y / height as f32;
        let depth = if self.perspective { self.project(point).1.abs() } else { 1.0 };
        let turn = if self.perspective { 1.0 } else { 0.0 };
        [depth, turn].map(|times| [self.right, -self.up].map(|axis| side * times * axis))
    }

    /// The pixel of a point; `None` where it is outside the picture or behind the camera.
    pub fn pixel(&self, point: Vec3, width: u32, height: u32) -> Option<[u32; 2]> {
        let (projected, depth) = self.project(point);
        let at = projected.truncate() / projected.z;
        if depth <= 0.0 || !(at.x.abs() < 1.0 && at.y.abs() < 1.0) {
            return None;
        }
        let (x, y) = (0.5 * (1.0 + at.x) * width as f32, 0.5 * (1.0 - at.y) * height as f32);
        Some([(x as u32).min(width - 1), (y as u32).min(height - 1)])
    }

    /// Pixels [x0, x1) × [y0, y1) that can see an ellipsoid of revolution, as [x0, x1, y0, y1];
    /// `None` where none can. Its semi-axis along the unit `normal` is half the `radius`.
    pub fn window(
        &self,
        center: Vec3,
        normal: Vec3,
        radius: f32,
        [width, height]: [u32; 2],
    ) -> Option<[u32; 4]> {
        let (projected, depth) = self.project(center);
        // Half the side of its box in the camera's axes.
        let extent = |axis: Vec3| {
            let along = axis.dot(normal);
            radius * (1.0 - 0.75 * along * along).max(0.25).sqrt()
        };
        let deep = extent(self.forward);
        if depth + deep <= 0.0 {
            return None;
        }
        let (near, far) = match self.perspective {
            true => (depth - deep, depth + deep),
            false => (1.0, 1.0),
        };
        if near <= 1e-3 * deep {
            return Some([0, width, 0, height]);
        }
        let side = |middle: f32, half: f32, count: u32| {
            let (low, high) = (middle - half, middle + half);
            let low = low / if low < 0.0 { near } else { far };
            let high = high / if high > 0.0 { near } else { far };
            let at = |x: f32| ((0.5 * (1.0 + x) * count as f32).max(0.0) as u32).min(count);
            (at(low), (at(high) + 1).min(count))
        };
        let (x0, x1) = side(projected.x, extent(self.right) / self.half.x, width);
        let (y0, y1) = side(-projected.y, extent(self.up) / self.half.y, height);
        (x0 < x1 && y0 < y1).then_some([x0, x1, y0, y1])
    }

    /// Pixels [x0, x1) × [y0, y1) that can see what lies between the corners of a box, as
    /// [x0, x1, y0, y1]; `None` where none can.
    pub fn box_of(&self, corners: &[Vec3; 8], [width, height]: [u32; 2]) -> Option<[u32; 4]> {
        let projected = corners.map(|corner| self.project(corner));
        if projected.iter().all(|(_, depth)| *depth <= 0.0) {
            return None;
        }
        if self.perspective && projected.iter().any(|(at, _)| at.z <= 1e-6 * at.abs().max_element())
        {
            return Some([0, width, 0, height]);
        }
        let at = projected.map(|(at, _)| at.truncate() / at.z);
        let low = at.into_iter().fold(Vec2::INFINITY, Vec2::min);
        let high = at.into_iter().fold(Vec2::NEG_INFINITY, Vec2::max);
        // With a pixel more on each side for rounding.
        let side = |low: f32, high: f32, count: u32| {
            let pixel = |x: f32| 0.5 * (1.0 + x) * count as f32;
            let first = (pixel(low) - 1.0).max(0.0) as u32;
            (first.min(count), ((pixel(high) + 2.0).max(0.0) as u32).min(count))
        };
        let (x0, x1) = side(low.x, high.x, width);
        let (y0, y1) = side(-high.y, -low.y, height);
        (x0 < x1 && y0 < y1).then_some([x0, x1, y0, y1])
    }

    /// The part of a triangle in front of an orthographic camera, as up to two triangles. (For a
    /// perspective camera the sign of homogeneous coordinates clips.)
    fn in_front(&self, corners: [Vec3; 3]) -> [Option<[Vec3; 3]>; 2] {
        let depths = corners.map(|corner| self.project(corner).1);
        if self.perspective || depths.iter().all(|depth| *depth >= 0.0) {
            return [Some(corners), None];
        }
        let mut left = [Vec3::ZERO; 4];
        let mut count = 0;
        for k in 0..3 {
            let next = (k + 1) % 3;
            let (own, other) = (depths[k], depths[next]);
            if own >= 0.0 {
                left[count] = corners[k];
                count += 1;
            }
            if (own < 0.0) != (other < 0.0) {
                left[count] = corners[k].lerp(corners[next], own / (own - other));
                count += 1;
            }
        }
        let [a, b, c, d] = left;
        [(count >= 3).then_some([a, b, c]), (count == 4).then_some([a, c, d])]
    }

    /// Homogeneous coordinates of a point, and its distance along the optical axis.
    fn project(&self, point: Vec3) -> (Vec3, f32) {
        let relative = point - self.eye;
        let depth = relative.dot(self.forward);
        let xy = Vec2::new(relative.dot(self.right), relative.dot(self.up)) / self.half;
        (xy.extend(if self.perspective { depth } else { 1.0 }), depth)
    }
}

impl View {
    /// Sets up all facets that show patches to the camera: fronts, and backs of two-sided materials.
    pub fn new(scene: &PatchedScene, camera: &Camera, width: u32, height: u32) -> Self {
        Self::of_listed(scene, camera, [width, height], |facet| facet.back != NO_PATCH)
    }

    /// Sets up all facets of a scene that the camera can see, those from behind that `shows_back`.
    fn of_listed(
        scene: &PatchedScene,
        camera: &Camera,
        [width, height]: [u32; 2],
        shows_back: impl Fn(&Facet) -> bool + Sync,
    ) -> Self {
        let mut view = Self::grid(camera, width, height);
        let corners = |facet: u32| {
            scene.facets[facet as usize].corners.map(|corner| scene.positions[corner as usize])
        };
        let two_sided = |facet: u32| shows_back(&scene.facets[facet as usize]);
        let farthest =
            scene.positions.iter().map(|p| view.frame.project(*p).1).fold(0f32, f32::max);
        let all = view.set_up_all(scene.facets.len(), farthest, corners, two_sided);
        view.triangles.extend(all.into_iter().flatten().map(|(triangle, _)| triangle));
        view
    }

    /// All facets of a scene, which may be a crowd, that are there for the camera: also backs without
    /// patches, of what lets light out or, if the camera is `within` a closed body, of such bodies.
    pub fn of_cut(cut: &Cut, camera: &Camera, [width, height]: [u32; 2], within: bool) -> Self {
        let crowd = match cut {
            Cut::Listed(listed) => {
                let shows_back = |facet: &Facet| {
                    let material = listed.scene.material_of(facet.source);
                    let is_there = material.is_there_from_behind();
                    is_there && (within || !facet.cull_back || material.clear_share() > 0.0)
                };
                return Self::of_listed(listed, camera, [width, height], shows_back);
            }
            Cut::Crowd(crowd) => crowd,
        };
        let mut view = Self::grid(camera, width, height);
        let corners = |facet: u32| cut.corners(FacetIndex(facet));
        // Instances are seen by rays.
        let count = crowd.scene.triangles.len();
        let depth_of = |facet: usize| {
            corners(facet as u32)
                .map(|corner| view.frame.project(corner).1)
                .into_iter()
                .fold(0f32, f32::max)
        };
        let farthest = match view.frame.perspective {
            // Not asked for.
            true => 0.0,
            false => (0..count).into_par_iter().map(depth_of).reduce(|| 0.0, f32::max),
        };
        let two_sided = |facet: u32| crowd.scene.material_of(facet).is_there_from_behind();
        let all = view.set_up_all(count, farthest, corners, two_sided);
        let total = all.iter().map(Vec::len).sum();
        view.triangles.reserve_exact(total);
        view.boxes.reserve_exact(total);
        for (triangle, pixels) in all.into_iter().flatten() {
            view.triangles.push(triangle);
            view.boxes.push(pixels);
        }
        view
    }

    /// The pixels of a camera's picture, without any facets.
    pub fn grid(camera: &Camera, width: u32, height: u32) -> Self {
        let frame = Frame::new(camera, width, height);
        Self { width, height, frame, triangles: Vec::new(), boxes: Vec::new() }
    }

    fn set_up_all(
        &self,
        count: usize,
        farthest: f32,
        corners: impl Fn(u32) -> [Vec3; 3] + Sync,
        two_sided: impl Fn(u32) -> bool + Sync,
    ) -> Vec<Vec<(ViewTriangle, PixelBox)>> {
        let of_chunk = |chunk: usize| {
            let facets = (chunk * CHUNK) as u32..((chunk + 1) * CHUNK).min(count) as u32;
            let mut triangles = Vec::new();
            for facet in facets {
                let sides = two_sided(facet);
                for corners in self.frame.in_front(corners(facet)).into_iter().flatten() {
                    triangles.extend(self.set_up(facet, corners, sides, farthest));
                }
            }
            triangles
        };
        (0..count.div_ceil(CHUNK)).into_par_iter().map(of_chunk).collect()
    }

    /// Triangles that may be seen in the given rows.
    pub fn in_rows(&self, first: u32, end: u32) -> Vec<&ViewTriangle> {
        self.triangles.iter().filter(|t| t.rows.0 < end && t.rows.1 > first).collect()
    }

    /// The same with boxes beside which none of their samples lies.
    pub fn boxed_in_rows(&self, first: u32, end: u32) -> Vec<(PixelBox, &ViewTriangle)> {
        let boxes = self.boxes.iter().copied().chain(std::iter::repeat(PixelBox::ALL));
        let all = boxes.zip(&self.triangles);
        all.filter(|(_, triangle)| triangle.rows.0 < end && triangle.rows.1 > first).collect()
    }

    /// Unit direction in which a place on the pixel grid looks, given in pixels from the centre of
    /// the first one, columns and rows.
    pub fn direction(&self, place: Vec2) -> Vec3 {
        let share = (place + 0.5) / Vec2::new(self.width as f32, self.height as f32);
        self.frame.ray(Vec2::new(2.0 * share.x - 1.0, 1.0 - 2.0 * share.y)).1
    }

    /// Edge functions of a facet without the sub-pixel offset.
    pub fn edges(&self, corners: [Vec3; 3]) -> [PixelPlane; 3] {
        exact_edge_planes(corners.map(|corner| self.frame.project(corner).0))
            .map(|plane| self.pixel_plane(plane))
    }

    fn pixel_plane(&self, plane: DVec3) -> PixelPlane {
        let step = 2.0 / DVec2::new(f64::from(self.width), f64::from(self.height));
        let constant = plane.z + plane.x * (0.5 * step.x - 1.0) + plane.y * (1.0 - 0.5 * step.y);
        PixelPlane {
            per_column: (plane.x * step.x) as f32,
            per_row: (-plane.y * step.y) as f32,
            constant: constant as f32,
        }
    }

    fn set_up(
        &self,
        index: u32,
        corners: [Vec3; 3],
        two_sided: bool,
        farthest: f32,
    ) -> Option<(ViewTriangle, PixelBox)> {
        let projected = corners.map(|corner| self.frame.project(corner));
        let depths = projected.map(|p| p.1);
        if depths.iter().all(|depth| *depth <= 0.0) {
            return None;
        }
        let corners = projected.map(|p| p.0);
        // In double precision: the planes of long thin triangles are small differences of large numbers.
        let edges = exact_edge_planes(corners);
        let sum = edges[0] + edges[1] + edges[2];
        // x right, y up, z forward is left-handed: a front has positive volume.
        let volume =
            if self.frame.perspective { corners[0].as_dvec3().dot(edges[0]) } else { sum.z };
        if volume == 0.0 || !volume.is_finite() || (volume < 0.0 && !two_sided) {
            return None;
        }
        let nearness = if self.frame.perspective {
            sum / volume
        } else {
            let all = edges.iter().zip(depths);
            let depth: DVec3 = all.map(|(edge, depth)| *edge * f64::from(depth)).sum();
            DVec3::Z * f64::from(1.1 * farthest.max(f32::MIN_POSITIVE)) - depth / sum.z
        };
        let edges = if volume < 0.0 { edges.map(|edge| -edge) } else { edges };
        let rows = self.rows(&corners);
        let pixels = self.pixels(&corners);
        (rows.0 < rows.1 && pixels.meets_columns(self.width)).then(|| {
            let triangle = ViewTriangle {
                edges: edges.map(|plane| self.pixel_plane(plane)),
                nearness: self.pixel_plane(nearness),
                rows,
                code: item::encode(index, volume < 0.0),
            };
            (triangle, pixels)
        })
    }

    /// The box of the corners over the pixel grid.
    fn pixels(&self, corners: &[Vec3; 3]) -> PixelBox {
        if corners.iter().any(|corner| corner.z <= 1e-12) {
            return PixelBox::ALL;
        }
        let half = 0.5 * Vec2::new(self.width as f32, self.height as f32);
        PixelBox::new(corners.map(|corner| {
            let at = corner.truncate() / corner.z;
            Vec2::new(1.0 + at.x, 1.0 - at.y) * half - 0.5
        }))
    }

    /// Rows that may see the corners for any sub-pixel offset.
    fn rows(&self, corners: &[Vec3; 3]) -> (u32, u32) {
        if corners.iter().any(|corner| corner.z <= 1e-12) {
            return (0, self.height);
        }
        let row = |c: Vec3| (1.0 - c.y / c.z) * 0.5 * self.height as f32 - 0.5;
        let (first, end) = centre_range(corners.map(row), self.height);
        (first.saturating_sub(1), (end + 1).min(self.height))
    }
}
