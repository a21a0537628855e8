//! Irradiance of all lights at a point without occlusion: near lights in closed form, farther ones
//! by four quadrature points each, eight lights at a time. Lights are picked by it, too.

use super::polygon::PolygonLight;
use crate::radiometry::{Rgb, importance};
use glam::Vec3;

/// Blocks of consecutive lights, at most: running sums of their importance are kept to pick by.
const BLOCKS: usize = 16;
/// Lights that are computed together: floats in a 256-bit register.
const LANES: usize = 8;
/// Most lights for which all are evaluated; with more, a tree picks one (docs/decisions/0019).
pub const MOST_LIGHTS: usize = 1024;
/// Most groups of eight lights in a block.
const BLOCK_EIGHTS: usize = MOST_LIGHTS / BLOCKS / LANES;
/// Distance, in diameters, within which a light among many is evaluated in closed form. Four quadrature points are off by
/// .2 % of it there (rms), at one diameter by 3 %.
const CLOSE: f32 = 2.0;
/// How far a light reaches beyond its quadrature points, in what lies between them: .37 for a rectangle, at most .67
/// for others. Where the horizon may cut it these say little of what is above, however far away it is.
const BEYOND_POINTS: f32 = 0.7;

/// Lower bound of the share that a lobe is taken to reflect of a light, of what it reflects at
/// most: it keeps the probability of every light that shines above zero.
const LEAST_LOBE_SHARE: f32 = 0.02;

type Lanes = [f32; LANES];

/// Irradiance of the lights at a point without occlusion, with the sums by which lights are picked.
#[derive(Clone, Copy)]
pub struct Unoccluded {
    /// The point, ray units, and the unit normal there.
    at: [Vec3; 2],
    /// Irradiance of all together.
    pub irradiance: Rgb,
    /// Running sums, over blocks of lights, of the importance of the irradiance, or of what a lobe
    /// reflects of it.
    sums: [f32; BLOCKS],
    /// The lobe, if lights are picked by what it may reflect of them.
    lobe: Option<LobeAxis>,
}

/// Axis and exponent of a lobe, by which it picks lights.
#[derive(Clone, Copy)]
pub struct LobeAxis {
    /// Unit vector along the middle of the lobe: the mirrored direction to the viewer.
    pub direction: Vec3,
    /// Exponent of the cosine.
    pub exponent: f32,
    /// The same of what it reflects of narrow lights ([`super::DirectLights::narrow`]), less where that is blurred.
    pub of_narrow: f32,
}

impl Unoccluded {
    /// No light: nothing can be picked.
    pub fn none() -> Self {
        Self { at: [Vec3::ZERO; 2], irradiance: Rgb::ZERO, sums: [0.0; BLOCKS], lobe: None }
    }

    /// Importance of all lights together, by which they are picked.
    pub fn importance(&self) -> f32 {
        self.sums.into_iter().fold(0.0, f32::max)
    }
}

/// All lights, to evaluate their closed forms eight at a time.
pub struct ClosedForms {
    lights: Vec<PolygonLight>,
    eights: Vec<EightLights>,
    /// Lights of a block: 1, or a multiple of eight.
    block_size: usize,
}

/// Eight lights by coordinates, with four quadrature points of each; unused lanes are zero.
struct EightLights {
    centers: [Lanes; 3],
    points: [[Lanes; 3]; 4],
    areas: [Lanes; 4],
    normals: [Lanes; 3],
    radiance: [Lanes; 3],
    importance: Lanes,
    /// Half the diameter.
    radius: Lanes,
    /// Square of the distance within which the quadrature is not exact enough.
    near: Lanes,
    /// −1 where the back shines too, 0 where it does not.
    back: Lanes,
}

impl ClosedForms {
    /// Groups the lights in eights and blocks, in their order.
    pub fn new(lights: Vec<PolygonLight>) -> Self {
        let few = lights.len() <= BLOCKS;
        let eights = lights.chunks(LANES).map(EightLights::new).collect::<Vec<_>>();
        let block_size = if few { 1 } else { eights.len().div_ceil(BLOCKS) * LANES };
        Self { lights, eights: if few { Vec::new() } else { eights }, block_size }
    }

    /// The lights.
    pub fn lights(&self) -> &[PolygonLight] {
        &self.lights
    }

    /// Irradiance of all lights on a surface at `point` with unit `normal`.
    pub fn unoccluded(&self, point: Vec3, normal: Vec3) -> Unoccluded {
        let mut all = Unoccluded { at: [point, normal], ..Unoccluded::none() };
        let mut sum = 0.0;
        if self.block_size == 1 {
            for (light, running) in self.lights.iter().zip(&mut all.sums) {
                let irradiance = light.radiance * light.projected(point, normal);
                all.irradiance += irradiance;
                sum += importance(irradiance);
                *running = sum;
            }
            return all;
        }
        let eights = self.eights.chunks(self.block_size / LANES);
        for ((block, eights), running) in eights.enumerate().zip(&mut all.sums) {
            let mut near = [0; BLOCK_EIGHTS];
            let mut shine = [[0.0; LANES]; 3];
            add_irradiance(eights, point, normal, &mut shine, &mut near);
            let mut irradiance = Rgb::from_array(shine.map(|lanes| lanes.iter().sum()));
            for (eight, mut near) in near.into_iter().enumerate() {
                while near != 0 {
                    let lane = near.trailing_zeros() as usize;
                    near &= near - 1;
                    let light = &self.lights[block * self.block_size + eight * LANES + lane];
                    irradiance += light.radiance * light.projected(point, normal);
                }
            }
            all.irradiance += irradiance;
            sum += importance(irradiance);
            *running = sum;
        }
        all
    }

    /// Sums by which a lobe picks lights: irradiance times about what the lobe reflects of it.
    /// Their irradiance is left zero.
    pub fn for_lobe(&self, point: Vec3, normal: Vec3, axis: LobeAxis) -> Unoccluded {
        let mut all = Unoccluded { at: [point, normal], lobe: Some(axis), ..Unoccluded::none() };
        let mut sum = 0.0;
        for block in 0..self.blocks() {
            let importances = self.importances(block, &all);
            let mut lanes = [0.0; LANES];
            for eight in importances.iter().take(self.block_size.div_ceil(LANES)) {
                for (lane, own) in lanes.iter_mut().zip(eight) {
                    *lane += own;
                }
            }
            sum += lanes.iter().sum::<f32>();
            all.sums[block] = sum;
        }
        all
    }

    /// Number of running sums.
    fn blocks(&self) -> usize {
        self.lights.len().div_ceil(self.block_size)
    }

    /// A light for a uniform number, by what each shines at the point that `all` is of, and the
    /// probability that it is this one; `None` where nothing shines there.
    pub fn pick(&self, all: &Unoccluded, x: f32) -> Option<(usize, f32)> {
        let blocks = self.blocks();
        let sums = &all.sums[..blocks];
        let total = sums[blocks - 1];
        if total <= 0.0 {
            return None;
        }
        let at = x * total;
        let block = sums.partition_point(|sum| *sum <= at).min(blocks - 1);
        let mut sum = if block == 0 { 0.0 } else { sums[block - 1] };
        if self.block_size == 1 {
            return Some((block, (sums[block] - sum) / total));
        }
        let first = block * self.block_size;
        let importances = self.importances(block, all);
        let mut picked = None;
        for (index, own) in importances.as_flattened().iter().take(self.block_size).enumerate() {
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

    /// The probability that [`ClosedForms::pick`] picks this light.
    pub fn probability(&self, all: &Unoccluded, light: usize) -> f32 {
        let total = all.sums[self.blocks() - 1];
        if total <= 0.0 {
            return 0.0;
        }
        let block = light / self.block_size;
        let importances = self.importances(block, all);
        importances.as_flattened()[light - block * self.block_size] / total
    }

    /// Importance of each light of a block, in proportion to which one is picked.
    fn importances(&self, block: usize, all: &Unoccluded) -> [Lanes; BLOCK_EIGHTS] {
        let Unoccluded { at: [point, normal], lobe, .. } = *all;
        #[cfg(target_arch = "x86_64")]
        {
            #[target_feature(enable = "avx2")]
            fn with_avx2(
                all: &ClosedForms,
                block: usize,
                point: Vec3,
                normal: Vec3,
                lobe: Option<LobeAxis>,
            ) -> [Lanes; BLOCK_EIGHTS] {
                all.importances_by_eights(block, point, normal, lobe)
            }
            if is_x86_feature_detected!("avx2") {
                // SAFETY: the processor has AVX2.
                return unsafe { with_avx2(self, block, point, normal, lobe) };
            }
        }
        self.importances_by_eights(block, point, normal, lobe)
    }

    #[inline(always)]
    fn importances_by_eights(
        &self,
        block: usize,
        point: Vec3,
        normal: Vec3,
        lobe: Option<LobeAxis>,
    ) -> [Lanes; BLOCK_EIGHTS] {
        let mut all = self.projected(block, point, normal);
        let first = block * self.block_size;
        if self.block_size == 1 {
            let light = &self.lights[first];
            let radius = 0.5 * light.diameter_squared.sqrt();
            let between = (light.center - point).to_array();
            let share = lobe.map_or(1.0, |axis| axis.reflected_share(between, radius));
            all[0][0] *= importance(light.radiance) * share;
            return all;
        }
        let last = (first + self.block_size).min(self.lights.len());
        let eights = &self.eights[first / LANES..last.div_ceil(LANES)];
        for (eight, all) in eights.iter().zip(&mut all) {
            let [x, y, z] = &eight.centers;
            for (all, importance) in all.iter_mut().zip(&eight.importance) {
                *all *= importance;
            }
            if let Some(axis) = lobe {
                for l in 0..LANES {
                    let between = [x[l] - point.x, y[l] - point.y, z[l] - point.z];
                    all[l] *= axis.reflected_share(between, eight.radius[l]);
                }
            }
        }
        all
    }

    /// Projected solid angle ∫ cosθ dω of each light of a block.
    #[inline(always)]
    fn projected(&self, block: usize, point: Vec3, normal: Vec3) -> [Lanes; BLOCK_EIGHTS] {
        let mut projected = [[0.0; LANES]; BLOCK_EIGHTS];
        if self.block_size == 1 {
            projected[0][0] = self.lights[block].projected(point, normal);
            return projected;
        }
        let first = block * self.block_size;
        let last = (first + self.block_size).min(self.lights.len());
        let mut near = [0; BLOCK_EIGHTS];
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

impl LobeAxis {
    /// About how much of a light of that size the lobe reflects, of what it reflects at most; more
    /// where it reflects little, since rays by the lobe seldom find that.
    #[inline(always)]
    fn reflected_share(&self, [x, y, z]: [f32; 3], radius: f32) -> f32 {
        let per_distance = 1.0 / (x * x + y * y + z * z).max(1e-18).sqrt();
        let to = self.direction;
        let [x, y, z] = [x * per_distance - to.x, y * per_distance - to.y, z * per_distance - to.z];
        let beside = ((x * x + y * y + z * z).sqrt() - radius * per_distance).max(0.0);
        let fall = 1.0 + 0.25 * self.exponent * beside * beside;
        LEAST_LOBE_SHARE + 1.0 / (fall * fall)
    }
}

impl EightLights {
    fn new(lights: &[PolygonLight]) -> Self {
        let lanes = |of: &dyn Fn(&PolygonLight) -> f32| {
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
            near: lanes(&|light| CLOSE * CLOSE * light.diameter_squared),
            back: lanes(&|light| if light.two_sided { -1.0 } else { 0.0 }),
        }
    }

    /// Projected solid angle ∫ cosθ dω of each by quadrature; zero for those that are too near for
    /// that, or that the horizon may cut, which the bits of the second value mark.
    #[inline(always)]
    fn projected(&self, point: Vec3, normal: Vec3) -> (Lanes, u32) {
        let [nx, ny, nz] = &self.normals;
        let (mut all, mut low, mut high) = ([0.0; LANES], [f32::MAX; LANES], [f32::MIN; LANES]);
        for ([x, y, z], areas) in self.points.iter().zip(&self.areas) {
            for l in 0..LANES {
                let (x, y, z) = (x[l] - point.x, y[l] - point.y, z[l] - point.z);
                let square = (x * x + y * y + z * z).max(1e-18);
                let received = normal.x * x + normal.y * y + normal.z * z;
                (low[l], high[l]) = (low[l].min(received), high[l].max(received));
                let received = received.max(0.0);
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
            let emitted = -(nx[l] * x + ny[l] * y + nz[l] * z);
            let beyond = BEYOND_POINTS * (high[l] - low[l]);
            let (is_below, is_cut) = (high[l] <= -beyond, low[l] < beyond);
            let far = is_below
                | ((square >= self.near[l]) & !is_cut)
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

/// Adds the lights' irradiance by quadrature to `shine`, by channel, but for those that are too
/// near, which the bits of `near` mark.
fn add_irradiance(
    eights: &[EightLights],
    point: Vec3,
    normal: Vec3,
    shine: &mut [Lanes; 3],
    near: &mut [u32; BLOCK_EIGHTS],
) {
    #[cfg(target_arch = "x86_64")]
    {
        #[target_feature(enable = "avx2")]
        fn with_avx2(
            eights: &[EightLights],
            point: Vec3,
            normal: Vec3,
            shine: &mut [Lanes; 3],
            near: &mut [u32; BLOCK_EIGHTS],
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
    eights: &[EightLights],
    point: Vec3,
    normal: Vec3,
    shine: &mut [Lanes; 3],
    near: &mut [u32; BLOCK_EIGHTS],
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
    fn lights(count: usize) -> Vec<PolygonLight> {
        let mut random = Numbers::new(7, Stream::Light, 0);
        let mut next = || Vec3::from_array([0; 3].map(|_| 2.0 * random.uniform() - 1.0));
        (0..count)
            .map(|index| {
                let (at, u, v) = (3.0 * next(), 0.4 * next(), 0.4 * next());
                let corners = [at, at + u, at + u + v, at + v];
                let corners = if index % 3 == 0 { &corners[..3] } else { &corners[..] };
                let radiance = (next() + 1.1).max(Vec3::ZERO);
                PolygonLight::new(corners, radiance, index % 5 == 0).unwrap()
            })
            .collect()
    }

    #[test]
    fn a_lobe_asks_for_what_it_looks_at() {
        for count in [5, 100] {
            let all = ClosedForms::new(lights(count));
            let (point, normal) = (Vec3::new(0.1, -3.0, 0.2), Vec3::Y);
            let direction = Vec3::new(0.3, 0.9, -0.1).normalize();
            let for_lobe = all.for_lobe(
                point,
                normal,
                LobeAxis { direction, exponent: 200.0, of_narrow: 200.0 },
            );
            let (mut total, mut ahead) = (0.0, 0.0);
            for index in 0..count {
                let probability = all.probability(&for_lobe, index);
                let plain = all.probability(&all.unoccluded(point, normal), index);
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
                let (light, probability) = all.pick(&for_lobe, x).unwrap();
                let same = all.probability(&for_lobe, light);
                assert!((same - probability).abs() <= 1e-4 * same, "{same} {probability}");
            }
        }
    }

    /// Rays from all over a pixel go to lights that are picked by what they shine on its middle: over its
    /// probability, what such a light shines where a ray starts is on average what all do.
    #[test]
    fn what_is_picked_at_one_point_tells_of_the_light_at_another() {
        const TRIES: usize = 50_000;
        let (point, normal) = (Vec3::new(0.1, -3.0, 0.2), Vec3::Y);
        for count in [5, 100] {
            let all = ClosedForms::new(lights(count));
            let at_point = all.unoccluded(point, normal);
            for other in [Vec3::new(1.1, -3.0, 0.1), Vec3::new(0.1, -3.0, -0.9)] {
                let shine = |light: &PolygonLight| light.radiance * light.projected(other, normal);
                let is_picked = |index: &usize| all.probability(&at_point, *index) > 0.0;
                let exact: Rgb =
                    (0..count).filter(is_picked).map(|l| shine(&all.lights()[l])).sum();
                let mut sum = Rgb::ZERO;
                for k in 0..TRIES {
                    let x = (k as f32 + 0.5) / TRIES as f32;
                    let (light, probability) = all.pick(&at_point, x).unwrap();
                    sum += shine(&all.lights()[light]) / probability;
                }
                let mean = sum / TRIES as f32;
                let at_first = at_point.irradiance;
                assert!(
                    (at_first / exact - 1.0).abs().max_element() > 0.05,
                    "it is the same there"
                );
                let off = (mean / exact - 1.0).abs().max_element();
                assert!(off < 0.02, "{count}: {mean} instead of {exact}");
            }
        }
    }

    /// A lamp beside many faint lights, at several distances, whole and cut by the horizon: as right as alone.
    #[test]
    fn one_bright_light_among_many_is_as_right_as_alone() {
        let side = 0.64;
        let corners = [[0.0, 0.0], [side, 0.0], [side, side], [0.0, side]];
        let corners = corners.map(|[x, z]| Vec3::new(x, 0.0, z));
        let lamp = PolygonLight::new(&corners, Rgb::splat(50.0), false).expect("it has an area");
        let faint = |mut light: PolygonLight| {
            light.radiance *= 1e-6;
            light
        };
        let mut all: Vec<PolygonLight> = lights(99).into_iter().map(faint).collect();
        let up = lamp.normal.y.signum();
        all.push(lamp);
        let all = ClosedForms::new(all);
        let mut most = 0.0f32;
        for height in [0.3, 0.6, 0.9, 1.2, 1.8, 3.0, 8.0] {
            for z in [-0.4, -0.1, 0.1, 0.28, 0.45, 0.6] {
                let (point, normal) = (Vec3::new(0.2, up * height, z), Vec3::Z);
                let lamp = &all.lights()[99];
                let exact = lamp.radiance.x * lamp.projected(point, normal);
                let found = all.unoccluded(point, normal).irradiance.x;
                assert!(exact > 0.0);
                most = most.max((found / exact - 1.0).abs());
            }
        }
        println!("off by {most:.4}");
        assert!(most < 0.005, "{most}");
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
                    let (light, probability) = all.pick(&unoccluded, x).unwrap();
                    let same = all.probability(&unoccluded, light);
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
