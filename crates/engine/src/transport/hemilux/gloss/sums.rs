//! What the rays of a lobe found, as sums.
//!
//! Where a sky shines, most of what lobes reflect is its light, and most of what scatters is how
//! that varies within the lobe. But the sky alone, with nothing in the way, is known without a ray
//! being traced ([`batch`]). So each ray also says what it would bring of an open sky; what
//! all of them bring is corrected by the difference between the known light of an open sky and the
//! mean of what they say of it (a control variate), times a factor: about the share of the sky that
//! is seen. The factor comes from the rays of the lobes beside it, so that it knows nothing of the
//! chance in its own, which would bias the mean. In the open nothing scatters then.
//!
//! Where textures vary, the albedo over the pixel is read from these, and what rays are asked for is
//! radiance over albedo alone: what scatters with the albedo is no noise of theirs.
//!
//! [`batch`]: super::open_sky::batch

use crate::radiometry::Rgb;
use bytemuck::{Pod, Zeroable};

/// Least albedo of a lobe that radiance is divided by.
const LEAST_ALBEDO: f32 = 1e-6;

/// Sums over the rays of a lobe. What neighbours share is their quotients: radiance over the lobe's
/// albedo. Checkpoints store them as they are: the order of the fields is part of the format.
#[derive(Clone, Copy, Default, Pod, Zeroable)]
#[repr(C)]
pub struct LobeSums {
    /// Σ radiance.
    radiance: Rgb,
    /// Σ radiance of the sky if it were open.
    open_rays: Rgb,
    /// Σ over batches of directions, none of them traced: their mean radiance of an open sky.
    open: Rgb,
    /// Σ over batches: albedos where their directions start.
    open_albedo: Rgb,
    /// Σ albedos of the lobe towards the camera.
    albedo: Rgb,
    /// Σ of what of the radiance is of narrow lights that paths hardly find.
    mirrored: Rgb,
    /// Σ of all channels' radiance of the sky that arrives.
    seen: f32,
    /// Σ radiance², summed over the channels like the products and squares that follow.
    squares: f32,
    /// Σ radiance · that of an open sky.
    products: f32,
    /// Σ squares of that of an open sky.
    open_ray_squares: f32,
    /// Σ squares of the batches' means.
    open_squares: f32,
    /// Σ radiance · albedo; like the four that follow 0 where the rays' own albedos count.
    albedo_products: f32,
    /// Σ radiance of an open sky · albedo.
    albedo_open_products: f32,
    /// Σ squares of albedos.
    albedo_squares: f32,
    /// Σ over batches: mean · albedo where its directions start.
    batch_products: f32,
    /// Σ over batches: squares of these albedos.
    batch_squares: f32,
    /// Σ 1/distance to what they met.
    nearness: f32,
    /// Rays so far.
    pub rays: u32,
    /// Batches so far.
    pub batches: u32,
}

/// What a ray of a lobe found.
pub struct Found {
    /// Radiance.
    pub radiance: Rgb,
    /// What of it is the sky's, at the first lobe.
    pub sky: Rgb,
    /// What that would be if nothing were in the way.
    pub open_sky: Rgb,
    /// What of the radiance is of narrow lights that paths hardly find.
    pub mirrored: Rgb,
    /// Albedo of the lobe towards the camera; 1 of what is clear, 0 where the shading normal faces
    /// away.
    pub albedo: Rgb,
    /// 1/distance to what it met.
    pub nearness: f32,
}

impl LobeSums {
    /// Adds a ray; `is_told` where the albedo over the pixel is told by others.
    pub fn add(&mut self, found: Found, is_told: bool) {
        self.radiance += found.radiance;
        self.open_rays += found.open_sky;
        self.albedo += found.albedo;
        self.mirrored += found.mirrored;
        self.seen += found.sky.element_sum();
        self.squares += found.radiance.length_squared();
        self.products += found.radiance.dot(found.open_sky);
        self.open_ray_squares += found.open_sky.length_squared();
        if is_told {
            self.albedo_products += found.radiance.dot(found.albedo);
            self.albedo_open_products += found.open_sky.dot(found.albedo);
            self.albedo_squares += found.albedo.length_squared();
        }
        self.nearness += found.nearness;
        self.rays += 1;
    }

    /// Adds a batch of directions along which an open sky has that mean, from a place of that albedo;
    /// `is_told` as with rays.
    pub fn add_batch(&mut self, (mean, albedo): (Rgb, Rgb), is_told: bool) {
        self.open += mean;
        self.open_albedo += albedo;
        self.open_squares += mean.length_squared();
        if is_told {
            self.batch_products += mean.dot(albedo);
            self.batch_squares += albedo.length_squared();
        }
        self.batches += 1;
    }

    /// Whether any ray has found light of the sky.
    pub fn sees_sky(&self) -> bool {
        self.seen > 0.0
    }

    /// Whether this can be what rays left: no more of them than that.
    pub fn is_possible(&self, most_rays: u32) -> bool {
        self.rays <= most_rays && self.batches <= most_rays
    }

    /// Mean radiance of narrow lights that paths hardly find.
    pub fn mirrored(&self) -> Rgb {
        self.mirrored / self.count()
    }

    /// Mean of 1/distance.
    pub fn nearness(&self) -> f32 {
        self.nearness / self.rays.max(1) as f32
    }

    /// Radiance over albedo beside that share of the open sky, by the rays alone: its mean, and the
    /// variance of that, summed over the channels.
    pub fn rest(&self, factor: f32) -> (Rgb, f32) {
        let mean = (self.radiance - factor * self.open_rays) / self.count();
        self.over_albedo(mean, self.ray_variance(factor) / self.count())
    }

    /// Radiance over albedo of the open sky by the batches: its mean, and the variance of that.
    pub fn open_sky(&self) -> (Rgb, f32) {
        let count = self.batches.max(1) as f32;
        let (_, variance) = self.over_albedo(Rgb::ZERO, self.batch_variance(1.0) / count);
        // Over their own: batches start at fewer places of the pixel than rays.
        (self.open / self.open_albedo.max(Rgb::splat(LEAST_ALBEDO * count)), variance)
    }

    fn count(&self) -> f32 {
        self.rays.max(1) as f32
    }

    /// Mean albedo.
    fn mean_albedo(&self) -> Rgb {
        (self.albedo / self.count()).max(Rgb::splat(LEAST_ALBEDO))
    }

    /// Mean and variance of radiance as those of radiance over albedo.
    fn over_albedo(&self, mean: Rgb, variance: f32) -> (Rgb, f32) {
        let albedo = self.mean_albedo();
        (mean / albedo, 3.0 * variance / albedo.length_squared())
    }

    /// How its rays vary with the open sky, and how that varies: Σ of products of what both differ
    /// from their means, and of squares.
    pub fn covariance(&self) -> [f32; 2] {
        let count = self.rays.max(1) as f32;
        let both = self.products - self.radiance.dot(self.open_rays) / count;
        let open = self.open_ray_squares - self.open_rays.length_squared() / count;
        [both, open.max(0.0)]
    }

    /// Whether the light of an open sky is known.
    pub fn knows_open_sky(&self) -> bool {
        self.batches > 0
    }

    /// What the lobe reflects of radiance over albedo with that mean and variance, the sum of all
    /// channels': mean and variance, of the channels alike. The albedo is the given one, or else that of
    /// its rays' places.
    pub fn reflected(&self, (mean, variance): (Rgb, f32), albedo: Option<Rgb>) -> [Rgb; 2] {
        let albedo = albedo.unwrap_or_else(|| self.mean_albedo());
        [mean * albedo, Rgb::splat(variance * albedo.length_squared() / 9.0)]
    }

    /// Variance of the radiance that a ray brings, corrected by that factor.
    pub fn ray_variance(&self, factor: f32) -> f32 {
        let count = self.rays.max(2) as f32;
        let mean = (self.radiance - factor * self.open_rays) / count;
        let squares =
            self.squares - factor * (2.0 * self.products - factor * self.open_ray_squares);
        let products = self.albedo_products - factor * self.albedo_open_products;
        let with_albedo = [products, self.albedo_squares].map(|sum| sum / count);
        variance([mean, self.albedo / count], squares / count, with_albedo)
            * (count / (count - 1.0))
    }

    /// Variance of the radiance that a batch brings to the correction.
    pub fn batch_variance(&self, factor: f32) -> f32 {
        let count = self.batches.max(2) as f32;
        let means = [self.open, self.open_albedo].map(|sum| sum / count);
        let with_albedo = [self.batch_products, self.batch_squares].map(|sum| sum / count);
        let own = variance(means, self.open_squares / count, with_albedo);
        factor * factor * own * (count / (count - 1.0))
    }
}

/// Variance of values with that mean and mean square beside a multiple of their albedos, of which the mean
/// product with the values and the mean square are given, as they are 0 where albedos do not count. The
/// multiple is one for all channels.
fn variance([mean, albedo]: [Rgb; 2], squares: f32, [products, albedo_squares]: [f32; 2]) -> f32 {
    if albedo_squares == 0.0 {
        return (squares - mean.length_squared()).max(0.0);
    }
    let times = mean.element_sum() / albedo.element_sum();
    let squares = squares - times * (2.0 * products - times * albedo_squares);
    (squares - (mean - times * albedo).length_squared()).max(0.0)
}

/// The factor by which rays vary with an open sky, by the covariances of several lobes; 0 where the
/// sky does not vary.
pub fn open_factor(covariances: impl Iterator<Item = [f32; 2]>) -> f32 {
    let [both, open] = covariances.fold([0.0, 0.0], |[a, b], [c, d]| [a + c, b + d]);
    if open > 0.0 { (both / open).clamp(0.0, 1.0) } else { 0.0 }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::{Numbers, Stream};

    /// A lobe of an uneven sky, of which `seen` is seen at random, under something else.
    fn sums(seed: u64, rays: u32, seen: f32, batches: u32) -> LobeSums {
        let mut numbers = Numbers::new(seed, Stream::Gloss, 0);
        let mut sums = LobeSums::default();
        let mut sky = move || 4.0 * Rgb::new(1.0, 0.5, 0.2) * numbers.uniform().powi(3);
        let mut others = Numbers::new(seed, Stream::Light, 0);
        for _ in 0..rays {
            let open_sky = sky();
            let is_seen = others.uniform() < seen;
            let met = if is_seen { open_sky } else { Rgb::splat(0.3) };
            let found = Found {
                radiance: met,
                sky: if is_seen { open_sky } else { Rgb::ZERO },
                open_sky,
                mirrored: Rgb::ZERO,
                albedo: Rgb::ONE,
                nearness: 0.0,
            };
            sums.add(found, false);
        }
        for _ in 0..batches {
            let mean = (0..8).map(|_| sky()).sum::<Rgb>() / 8.0;
            sums.add_batch((mean, Rgb::ONE), false);
        }
        sums
    }

    /// Of the mean radiance, summed over the channels.
    fn variance(sums: &LobeSums, factor: f32) -> f32 {
        sums.ray_variance(factor) / sums.rays as f32
            + sums.batch_variance(factor) / sums.batches.max(1) as f32
    }

    /// The mean is right, however much of the sky is seen, and its spread over seeds is what one
    /// lobe's variance says.
    #[test]
    fn mean_and_variance_are_those_over_seeds() {
        for seen in [0.1, 0.3, 0.8, 1.0] {
            let all: Vec<LobeSums> = (0..4000).map(|seed| sums(seed, 8, seen, 4)).collect();
            let beside = all.iter().cycle().skip(1).take(all.len());
            let factors: Vec<f32> =
                beside.map(|other| open_factor([other.covariance()].into_iter())).collect();
            let means: Vec<Rgb> =
                all.iter().zip(&factors).map(|(s, f)| s.rest(*f).0 + *f * s.open_sky().0).collect();
            let count = all.len() as f32;
            let mean = means.iter().sum::<Rgb>() / count;
            let exact = seen * Rgb::new(1.0, 0.5, 0.2) + (1.0 - seen) * Rgb::splat(0.3);
            let off = (mean / exact - Rgb::ONE).abs().max_element();
            assert!(off < 0.02, "{seen}: {mean} {exact}");
            let spread = means.iter().map(|own| own.distance_squared(mean)).sum::<f32>() / count;
            let said = all.iter().zip(&factors).map(|(s, f)| variance(s, *f)).sum::<f32>() / count;
            assert!((said / spread - 1.0).abs() < 0.1, "{seen}: {said} {spread}");
        }
    }

    /// Where the albedo over the pixel is known, what varies with it is no noise: over seeds, radiance over
    /// albedo scatters as one lobe says, and less than radiance does.
    #[test]
    fn what_varies_with_a_known_albedo_is_no_noise() {
        const RAYS: u32 = 12;
        let textured = |seed: u64| {
            let mut numbers = Numbers::new(seed, Stream::Gloss, 0);
            let mut sums = LobeSums::default();
            for _ in 0..RAYS {
                let albedo =
                    Rgb::new(0.9, 0.6, 0.3) * if numbers.uniform() < 0.5 { 0.2 } else { 1.0 };
                let light = 1.0 + 0.2 * (numbers.uniform() - 0.5);
                let (radiance, dark) = (albedo * light, Rgb::ZERO);
                let found = Found {
                    radiance,
                    sky: dark,
                    open_sky: dark,
                    mirrored: dark,
                    albedo,
                    nearness: 0.0,
                };
                sums.add(found, true);
                sums.add_batch((radiance, albedo), true);
            }
            sums
        };
        let all: Vec<LobeSums> = (0..4000).map(textured).collect();
        let spread = |values: &[Rgb]| {
            let mean = values.iter().sum::<Rgb>() / values.len() as f32;
            let squares = values.iter().map(|own| own.distance_squared(mean)).sum::<f32>();
            squares / values.len() as f32
        };
        for of in [|sums: &LobeSums| sums.rest(0.0), LobeSums::open_sky] {
            let (values, said): (Vec<Rgb>, Vec<f32>) = all.iter().map(of).unzip();
            let (spread, said) = (spread(&values), said.iter().sum::<f32>() / all.len() as f32);
            // By the mean albedo of few rays, squared, what is said is somewhat more.
            assert!((0.8..1.5).contains(&(said / spread)), "{said} {spread}");
        }
        let radiance: Vec<Rgb> = all.iter().map(|sums| sums.radiance / sums.count()).collect();
        let relative = spread(&radiance) / all[0].mean_albedo().length_squared();
        assert!(3.0 * relative > 20.0 * all[0].rest(0.0).1, "{relative}");
    }

    /// In the open, rays say nothing that is not known: what varies is the batches alone.
    #[test]
    fn an_open_sky_has_no_noise_of_rays() {
        let open = sums(1, 8, 1.0, 64);
        let factor = open_factor([open.covariance()].into_iter());
        assert!((factor - 1.0).abs() < 1e-3 && open.ray_variance(factor) < 1e-4, "{factor}");
        assert!(variance(&open, 0.0) > 5.0 * variance(&open, factor));
    }
}
