//! What all lights shine on a point where nothing is in between: those near it in closed form,
//! those farther off by four points of each, eight lights at a time.

use super::polygon::Light;
use crate::radiometry::{Rgb, importance};
use glam::Vec3;

/// Running sums that are kept of a point's lights.
const SUMS: usize = 16;
/// Lights that are looked at together.
const LANES: usize = 8;
/// With more lights only some of them can be asked.
pub const MOST_LIGHTS: usize = 1024;
/// Eights of a running sum at most.
const EIGHTS: usize = MOST_LIGHTS / SUMS / LANES;
/// Nearer than so many diameters a light is evaluated in closed form; beyond, four points of it
/// are off by 3 % (rms), one light among many.
const NEAR: f32 = 1.0;

/// What a lobe is taken to reflect at least of every light.
const LEAST_SHARE: f32 = 0.02;

type Lanes = [f32; LANES];

/// What the lights would shine on a point with nothing in between.
#[derive(Clone, Copy)]
pub struct Unoccluded {
    /// Irradiance of all together.
    pub irradiance: Rgb,
    /// Importance of the irradiance, or of what a lobe makes of it, running over stretches of lights.
    sums: [f32; SUMS],
    /// The lobe, if lights are asked for by what it may reflect of them.
    lobe: Option<Axis>,
}

/// Where a lobe looks.
#[derive(Clone, Copy)]
pub struct Axis {
    /// Unit vector to what the middle of the lobe shows.
    pub direction: Vec3,
    /// Of the cosine.
    pub exponent: f32,
}

impl Unoccluded {
    /// Nothing shines.
    pub fn none() -> Self {
        Self { irradiance: Rgb::ZERO, sums: [0.0; SUMS], lobe: None }
    }
}

/// All lights, to evaluate their closed forms eight at a time.
pub struct ClosedForms {
    lights: Vec<Light>,
    eights: Vec<Eight>,
    /// Lights of a running sum.
    stretch: usize,
}

/// Eight lights: four points of each that stand for parts of it.
struct Eight {
    centers: [Lanes; 3],
    points: [[Lanes; 3]; 4],
    areas: [Lanes; 4],
    normals: [Lanes; 3],
    radiance: [Lanes; 3],
    importance: Lanes,
    /// Of the disk that holds it.
    radius: Lanes,
    /// Square of the distance within which that is not enough.
    near: Lanes,
    /// −1 where the back shines too, 0 where it does not.
    back: Lanes,
}

impl ClosedForms {
    /// Of the lights, in their order.
    pub fn new(lights: Vec<Light>) -> Self {
        let few = lights.len() <= SUMS;
        let eights = lights.chunks(LANES).map(Eight::new).collect::<Vec<_>>();
        let stretch = if few { 1 } else { eights.len().div_ceil(SUMS) * LANES };
        Self { lights, eights: if few { Vec::new() } else { eights }, stretch }
    }

    /// The lights.
    pub fn lights(&self) -> &[Light] {
        &self.lights
    }

    /// What they shine on a surface at `point` with unit `normal`.
    pub fn unoccluded(&self, point: Vec3, normal: Vec3) -> Unoccluded {
        let mut all = Unoccluded::none();
        let mut sum = 0.0;
        if self.stretch == 1 {
            for (light, running) in self.lights.iter().zip(&mut all.sums) {
                let irradiance = light.radiance * light.projected(point, normal);
                all.irradiance += irradiance;
                sum += importance(irradiance);
                *running = sum;
            }
            return all;
        }
        let eights = self.eights.chunks(self.stretch / LANES);
        for ((stretch, eights), running) in eights.enumerate().zip(&mut all.sums) {
            let mut near = [0; EIGHTS];
            let mut shine = [[0.0; LANES]; 3];
            add_up(eights, point, normal, &mut shine, &mut near);
            let mut irradiance = Rgb::from_array(shine.map(|lanes| lanes.iter().sum()));
            for (eight, mut near) in near.into_iter().enumerate() {
                while near != 0 {
                    let lane = near.trailing_zeros() as usize;
                    near &= near - 1;
                    let light = &self.lights[stretch * self.stretch + eight * LANES + lane];
                    irradiance += light.radiance * light.projected(point, normal);
                }
            }
            all.irradiance += irradiance;
            sum += importance(irradiance);
            *running = sum;
        }
        all
    }

    /// The same for a lobe: what the lights shine where it looks counts most.
    pub fn toward(&self, point: Vec3, normal: Vec3, axis: Axis) -> Unoccluded {
        let mut all = Unoccluded { lobe: Some(axis), ..Unoccluded::none() };
        let mut sum = 0.0;
        for (stretch, running) in (0..self.stretches()).zip(&mut all.sums) {
            let asked = self.asked(stretch, point, normal, Some(axis));
            let mut lanes = [0.0; LANES];
            for eight in asked.iter().take(self.stretch.div_ceil(LANES)) {
                for (lane, own) in lanes.iter_mut().zip(eight) {
                    *lane += own;
                }
            }
            sum += lanes.iter().sum::<f32>();
            *running = sum;
        }
        all
    }

    /// Number of running sums.
    fn stretches(&self) -> usize {
        self.lights.len().div_ceil(self.stretch)
    }

    /// A light for a uniform number, by what each shines on the point, and the probability that it
    /// is this one; `None` where nothing shines.
    pub fn pick(
        &self,
        all: &Unoccluded,
        point: Vec3,
        normal: Vec3,
        x: f32,
    ) -> Option<(usize, f32)> {
        let stretches = self.stretches();
        let sums = &all.sums[..stretches];
        let total = sums[stretches - 1];
        if total <= 0.0 {
            return None;
        }
        let at = x * total;
        let stretch = sums.partition_point(|sum| *sum <= at).min(stretches - 1);
        let mut sum = if stretch == 0 { 0.0 } else { sums[stretch - 1] };
        if self.stretch == 1 {
            return Some((stretch, (sums[stretch] - sum) / total));
        }
        let first = stretch * self.stretch;
        let asked = self.asked(stretch, point, normal, all.lobe);
        let mut picked = None;
        for (index, own) in asked.as_flattened().iter().take(self.stretch).enumerate() {
            sum += own;
            if *own > 0.0 {
                picked = Some((first + index, own / total));
                if sum > at {
                    break;
                }
            }
        }
        picked
    }

    /// The probability that [`All::pick`] picks this light.
    pub fn probability(&self, all: &Unoccluded, point: Vec3, normal: Vec3, light: usize) -> f32 {
        let total = all.sums[self.stretches() - 1];
        if total <= 0.0 {
            return 0.0;
        }
        let stretch = light / self.stretch;
        let asked = self.asked(stretch, point, normal, all.lobe);
        asked.as_flattened()[light - stretch * self.stretch] / total
    }

    /// What each light of a stretch counts where one is picked.
    fn asked(
        &self,
        stretch: usize,
        point: Vec3,
        normal: Vec3,
        lobe: Option<Axis>,
    ) -> [Lanes; EIGHTS] {
        #[cfg(target_arch = "x86_64")]
        {
            #[target_feature(enable = "avx2")]
            fn with_avx2(
                all: &ClosedForms,
                stretch: usize,
                point: Vec3,
                normal: Vec3,
                lobe: Option<Axis>,
            ) -> [Lanes; EIGHTS] {
                all.asked_by_eights(stretch, point, normal, lobe)
            }
            if is_x86_feature_detected!("avx2") {
                // SAFETY: the processor has AVX2.
                return unsafe { with_avx2(self, stretch, point, normal, lobe) };
            }
        }
        self.asked_by_eights(stretch, point, normal, lobe)
    }

    #[inline(always)]
    fn asked_by_eights(
        &self,
        stretch: usize,
        point: Vec3,
        normal: Vec3,
        lobe: Option<Axis>,
    ) -> [Lanes; EIGHTS] {
        let mut all = self.projected(stretch, point, normal);
        let first = stretch * self.stretch;
        if self.stretch == 1 {
            let light = &self.lights[first];
            let radius = 0.5 * light.diameter_squared.sqrt();
            let between = (light.center - point).to_array();
            let share = lobe.map_or(1.0, |axis| axis.share(between, radius));
            all[0][0] *= importance(light.radiance) * share;
            return all;
        }
        let last = (first + self.stretch).min(self.lights.len());
        let eights = &self.eights[first / LANES..last.div_ceil(LANES)];
        for (eight, all) in eights.iter().zip(&mut all) {
            let [x, y, z] = &eight.centers;
            for (all, importance) in all.iter_mut().zip(&eight.importance) {
                *all *= importance;
            }
            if let Some(axis) = lobe {
                for l in 0..LANES {
                    let between = [x[l] - point.x, y[l] - point.y, z[l] - point.z];
                    all[l] *= axis.share(between, eight.radius[l]);
                }
            }
        }
        all
    }

    /// ∫ cosθ dω over each light of a stretch.
    #[inline(always)]
    fn projected(&self, stretch: usize, point: Vec3, normal: Vec3) -> [Lanes; EIGHTS] {
        let mut projected = [[0.0; LANES]; EIGHTS];
        if self.stretch == 1 {
            projected[0][0] = self.lights[stretch].projected(point, normal);
            return projected;
        }
        let first = stretch * self.stretch;
        let last = (first + self.stretch).min(self.lights.len());
        let mut near = [0; EIGHTS];
        let eights = &self.eights[first / LANES..last.div_ceil(LANES)];
        for ((eight, projected), near) in eights.iter().zip(&mut projected).zip(&mut near) {
            (*projected, *near) = eight.projected(point, normal);
        }
        for index in 0..last - first {
            if near[index / LANES] >> (index % LANES) & 1 == 1 {
                projected.as_flattened_mut()[index] =
                    self.lights[first + index].projected(point, normal);
            }
        }
        projected
    }
}

impl Axis {
    /// About how much of a light of that size the lobe reflects, of what it reflects at most; more
    /// where it reflects little, since rays by the lobe seldom find that.
    #[inline(always)]
    fn share(&self, [x, y, z]: [f32; 3], radius: f32) -> f32 {
        let per_distance = 1.0 / (x * x + y * y + z * z).max(1e-18).sqrt();
        let to = self.direction;
        let [x, y, z] = [x * per_distance - to.x, y * per_distance - to.y, z * per_distance - to.z];
        let beside = ((x * x + y * y + z * z).sqrt() - radius * per_distance).max(0.0);
        let fall = 1.0 + 0.25 * self.exponent * beside * beside;
        LEAST_SHARE + 1.0 / (fall * fall)
    }
}

impl Eight {
    fn new(lights: &[Light]) -> Self {
        let lanes = |of: &dyn Fn(&Light) -> f32| {
            std::array::from_fn(|lane| lights.get(lane).map_or(0.0, of))
        };
        let axes = [0, 1, 2];
        let parts = [0, 1, 2, 3];
        Self {
            centers: axes.map(|axis| lanes(&|light| light.center[axis])),
            points: parts.map(|k| axes.map(|axis| lanes(&|light| light.quadrature()[k].0[axis]))),
            areas: parts.map(|k| lanes(&|light| light.quadrature()[k].1)),
            normals: axes.map(|axis| lanes(&|light| light.normal[axis])),
            radiance: axes.map(|axis| lanes(&|light| light.radiance[axis])),
            importance: lanes(&|light| importance(light.radiance)),
            radius: lanes(&|light| 0.5 * light.diameter_squared.sqrt()),
            near: lanes(&|light| NEAR * NEAR * light.diameter_squared),
            back: lanes(&|light| if light.two_sided { -1.0 } else { 0.0 }),
        }
    }

    /// ∫ cosθ dω over each by its points; those that are too near for that are left out, and
    /// told, a bit each.
    #[inline(always)]
    fn projected(&self, point: Vec3, normal: Vec3) -> (Lanes, u32) {
        let [nx, ny, nz] = &self.normals;
        let mut all = [0.0; LANES];
        for ([x, y, z], areas) in self.points.iter().zip(&self.areas) {
            for l in 0..LANES {
                let (x, y, z) = (x[l] - point.x, y[l] - point.y, z[l] - point.z);
                let square = (x * x + y * y + z * z).max(1e-18);
                let received = (normal.x * x + normal.y * y + normal.z * z).max(0.0);
                // Of two sides one shines here; a single one may be turned away.
                let emitted = -(nx[l] * x + ny[l] * y + nz[l] * z);
                let emitted = emitted.max(emitted * self.back[l]);
                all[l] += areas[l] * received * emitted / (square * square);
            }
        }
        let [x, y, z] = &self.centers;
        let mut too_near = [0.0; LANES];
        for l in 0..LANES {
            let (x, y, z) = (x[l] - point.x, y[l] - point.y, z[l] - point.z);
            let square = x * x + y * y + z * z;
            let received = normal.x * x + normal.y * y + normal.z * z;
            let emitted = -(nx[l] * x + ny[l] * y + nz[l] * z);
            let far = (square >= self.near[l])
                | ((received <= 0.0) & (received * received >= self.near[l]))
                | (emitted.max(emitted * self.back[l]) <= 0.0);
            too_near[l] = if far { 0.0 } else { 1.0 };
        }
        let mut near = 0;
        if too_near != [0.0; LANES] {
            for (l, too_near) in too_near.iter().enumerate() {
                near |= u32::from(*too_near > 0.0) << l;
                all[l] *= 1.0 - too_near;
            }
        }
        (all, near)
    }
}

/// Adds what the lights shine by their points, but for those that are too near, a bit each.
fn add_up(
    eights: &[Eight],
    point: Vec3,
    normal: Vec3,
    shine: &mut [Lanes; 3],
    near: &mut [u32; EIGHTS],
) {
    #[cfg(target_arch = "x86_64")]
    {
        #[target_feature(enable = "avx2")]
        fn with_avx2(
            eights: &[Eight],
            point: Vec3,
            normal: Vec3,
            shine: &mut [Lanes; 3],
            near: &mut [u32; EIGHTS],
        ) {
            add_by_eights(eights, point, normal, shine, near);
        }
        if is_x86_feature_detected!("avx2") {
            // SAFETY: the processor has AVX2.
            return unsafe { with_avx2(eights, point, normal, shine, near) };
        }
    }
    add_by_eights(eights, point, normal, shine, near);
}

#[inline(always)]
fn add_by_eights(
    eights: &[Eight],
    point: Vec3,
    normal: Vec3,
    shine: &mut [Lanes; 3],
    near: &mut [u32; EIGHTS],
) {
    for (eight, near) in eights.iter().zip(near) {
        let (projected, too_near) = eight.projected(point, normal);
        *near = too_near;
        for (sums, radiance) in shine.iter_mut().zip(&eight.radiance) {
            for l in 0..LANES {
                sums[l] += projected[l] * radiance[l];
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::{Numbers, Stream};

    /// Many small lights around a point, of one and of two sides, triangles and quadrilaterals.
    fn lights(count: usize) -> Vec<Light> {
        let mut random = Numbers::new(7, Stream::Light, 0);
        let mut next = || Vec3::from_array([0; 3].map(|_| 2.0 * random.uniform() - 1.0));
        (0..count)
            .map(|index| {
                let (at, u, v) = (3.0 * next(), 0.4 * next(), 0.4 * next());
                let corners = [at, at + u, at + u + v, at + v];
                let corners = if index % 3 == 0 { &corners[..3] } else { &corners[..] };
                let radiance = (next() + 1.1).max(Vec3::ZERO);
                Light::new(corners, radiance, index % 5 == 0).unwrap()
            })
            .collect()
    }

    #[test]
    fn a_lobe_asks_for_what_it_looks_at() {
        for count in [5, 100] {
            let all = ClosedForms::new(lights(count));
            let (point, normal) = (Vec3::new(0.1, -3.0, 0.2), Vec3::Y);
            let direction = Vec3::new(0.3, 0.9, -0.1).normalize();
            let toward = all.toward(point, normal, Axis { direction, exponent: 200.0 });
            let (mut total, mut ahead) = (0.0, 0.0);
            for index in 0..count {
                let probability = all.probability(&toward, point, normal, index);
                let plain = all.probability(&all.unoccluded(point, normal), point, normal, index);
                assert_eq!(probability > 0.0, plain > 0.0);
                total += probability;
                let to_light = (all.lights()[index].center - point).normalize();
                if to_light.dot(direction) > 0.99 && probability > 0.0 {
                    assert!(probability > plain, "{probability} {plain}");
                    ahead += 1.0;
                }
            }
            assert!((total - 1.0).abs() < 1e-4, "{total}");
            assert!(count < 100 || ahead > 0.0, "no light is ahead");
            const TRIES: usize = 5000;
            for k in 0..TRIES {
                let x = (k as f32 + 0.5) / TRIES as f32;
                let (light, probability) = all.pick(&toward, point, normal, x).unwrap();
                let same = all.probability(&toward, point, normal, light);
                assert!((same - probability).abs() <= 1e-4 * same, "{same} {probability}");
            }
        }
    }

    #[test]
    fn all_are_the_sum_of_each_and_are_picked_by_what_they_shine() {
        for count in [1, 5, 16, 17, 100, 1000] {
            let all = ClosedForms::new(lights(count));
            for (point, normal) in
                [(Vec3::ZERO, Vec3::Y), (Vec3::new(1.0, -2.0, 0.5), Vec3::new(0.6, 0.0, -0.8))]
            {
                let unoccluded = all.unoccluded(point, normal);
                let each = all.lights().iter();
                let each: Vec<Rgb> =
                    each.map(|light| light.radiance * light.projected(point, normal)).collect();
                let exact: Rgb = each.iter().sum();
                let off = (unoccluded.irradiance - exact).abs().max_element();
                assert!(off <= 1e-2 * exact.max_element(), "{count}: {off} of {exact}");
                if exact == Rgb::ZERO {
                    continue;
                }
                let mut shares = vec![0.0; count];
                const TRIES: usize = 50_000;
                for k in 0..TRIES {
                    let x = (k as f32 + 0.5) / TRIES as f32;
                    let (light, probability) = all.pick(&unoccluded, point, normal, x).unwrap();
                    let same = all.probability(&unoccluded, point, normal, light);
                    assert!((same - probability).abs() <= 1e-5, "{same} {probability}");
                    shares[light] += 1.0 / TRIES as f32;
                }
                for (share, irradiance) in shares.iter().zip(&each) {
                    let expected = importance(*irradiance) / importance(exact);
                    assert!(
                        (share - expected).abs() < 0.03 * expected + 1e-3,
                        "{share} {expected}"
                    );
                }
            }
        }
    }
}
