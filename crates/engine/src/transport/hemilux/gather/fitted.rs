//! Irradiance of a record by the plane through its neighbours and by its own rays.

use super::record::Record;
use crate::radiometry::Rgb;
use glam::{Mat3, Vec3};

/// Standard deviations of a variance from so many records by which scatter has to be over noise: both
/// are found from the same few.
const CHANCE: f32 = 2.0;
/// Variance of what is interpolated between records about what is so at records, as a share of the
/// variance of records about their planes.
const INTERPOLATED_BENT: f32 = 0.2;
/// Irradiance of a record by the plane fitted through its neighbours; the fields are those of
/// [`Record`].
pub struct FittedIrradiance {
    /// Value of the plane.
    pub value: Rgb,
    slope: [Vec3; 3],
    /// Its noise.
    pub noise: Rgb,
    noise_slope: [Vec3; 3],
    /// Variance about the plane beyond noise.
    pub bent: Rgb,
    between: Rgb,
    is_alone: bool,
}

impl FittedIrradiance {
    /// The record's own irradiance, where it has too few neighbours for a plane.
    pub fn alone([value, noise]: [Rgb; 2]) -> Self {
        let (slope, zero) = ([Vec3::ZERO; 3], Rgb::ZERO);
        let is_alone = true;
        Self { value, slope, noise, noise_slope: slope, bent: zero, between: zero, is_alone }
    }
}

impl Record {
    /// Takes in what was fitted.
    pub fn set_fit(&mut self, fit: FittedIrradiance) {
        (self.value, self.slope) = (fit.value, fit.slope);
        (self.noise, self.noise_slope) = (fit.noise, fit.noise_slope);
        (self.bent, self.between) = (fit.bent, fit.between);
        self.is_alone = fit.is_alone;
    }
}

/// Sums of a weighted least-squares plane through records' irradiances over their places along the
/// surface, in radii of the record in the middle. (The plane of [`crate::filter`] is one through
/// pixels.)
pub struct RecordPlane {
    /// Σ w (1, x, y)ᵀ(1, x, y).
    matrix: Mat3,
    /// Σ w (1, x, y)ᵀ E, per channel.
    right: Mat3,
    /// The same of the noise.
    noise: Mat3,
    /// Σ w².
    squares: f32,
    /// Σ w over rays.
    per_ray: f32,
    /// Σ w E².
    energy: Rgb,
    /// Σ w noise².
    noise_energy: Rgb,
    /// Least and largest irradiance of the records.
    range: Option<(Rgb, Rgb)>,
}

impl RecordPlane {
    /// A plane through no records yet. (`Mat3::default()` is the identity.)
    pub fn new() -> Self {
        Self {
            matrix: Mat3::ZERO,
            right: Mat3::ZERO,
            noise: Mat3::ZERO,
            squares: 0.0,
            per_ray: 0.0,
            energy: Rgb::ZERO,
            noise_energy: Rgb::ZERO,
            range: None,
        }
    }

    /// Adds a record with its weight around the one in the middle: an irradiance of it, and the noise of
    /// that.
    pub fn add(&mut self, center: &Record, (other, [e, noise]): (&Record, [Rgb; 2]), weight: f32) {
        let between = (other.point - center.point) / center.radius;
        let [tangent, bitangent] = center.tangents;
        let at = Vec3::new(1.0, between.dot(tangent), between.dot(bitangent));
        let (least, most) = self.range.unwrap_or((e, e));
        self.range = Some((least.min(e), most.max(e)));
        let weighted = at * weight;
        self.matrix += Mat3::from_cols(weighted * at.x, weighted * at.y, weighted * at.z);
        self.right += Mat3::from_cols(weighted * e.x, weighted * e.y, weighted * e.z);
        self.noise += Mat3::from_cols(weighted * noise.x, weighted * noise.y, weighted * noise.z);
        self.energy += e * e * weight;
        self.noise_energy += noise * noise * weight;
        self.squares += weight * weight;
        self.per_ray += weight / other.rays.max(1) as f32;
    }

    /// What the plane says of the record in the middle, whose own irradiance and noise are `mine`.
    pub fn fit(mut self, record: &Record, mine: [Rgb; 2]) -> FittedIrradiance {
        let total = self.matrix.x_axis.x;
        // Effective number of records.
        let count = total * total / self.squares.max(f32::MIN_POSITIVE);
        if total.is_nan() || total <= 0.0 || count < 3.0 {
            return FittedIrradiance::alone(mine);
        }
        let ridge = 0.01 * total;
        self.matrix.y_axis.y += ridge;
        self.matrix.z_axis.z += ridge;
        let inverse = self.matrix.inverse();
        if !inverse.is_finite() {
            return FittedIrradiance::alone(mine);
        }
        let [tangent, bitangent] = record.tangents;
        let along = |channel: Vec3| (tangent * channel.y + bitangent * channel.z) / record.radius;
        let solved = inverse * self.right;
        let channels = [solved.x_axis, solved.y_axis, solved.z_axis];
        // Value and slope stay within the records' range: docs/decisions/0012.
        let (least, most) = self.range.unwrap_or_default();
        let value = Rgb::from_array(channels.map(|c| c.x)).clamp(least, most);
        let range = (most - least) / record.radius;
        let slope = std::array::from_fn(|k| along(channels[k]).clamp_length_max(range[k]));
        let noise = inverse * self.noise;
        let noise = [noise.x_axis, noise.y_axis, noise.z_axis];
        // Σ w (E − plane)², by the normal equations; the plane takes three of the records.
        let explained =
            Rgb::from_array(std::array::from_fn(|k| channels[k].dot(self.right.col(k))));
        let scatter = (self.energy - explained) / total * (count / (count - 2.0).max(1.0));
        let scatter_by_noise = self.noise_energy / total;
        let bent = (scatter - scatter_by_noise).max(Rgb::ZERO);
        // The ridge flattens the plane a little, which is not in the sum above.
        let flattened = channels.map(|c| ridge * (c.y * c.y + c.z * c.z));
        let beyond = (scatter - Rgb::from_array(flattened) / total).max(Rgb::ZERO);
        let own = self.own_share(record, count, beyond - scatter_by_noise, scatter_by_noise);
        let fitted_noise = Rgb::from_array(noise.map(|c| c.x));
        FittedIrradiance {
            value: value + own * (mine[0] - value),
            slope,
            noise: fitted_noise + own * (mine[1] - fitted_noise),
            noise_slope: noise.map(along),
            bent: bent * ((1.0 - own) * (1.0 - own) + INTERPOLATED_BENT),
            between: bent * INTERPOLATED_BENT,
            is_alone: false,
        }
    }

    /// How much of a record's value is its own, rather than the plane's: as much as has the least
    /// expected squared error, by the variance of its own noise and by how far it may be off the
    /// plane (the linear estimate of Wiener). Of scatter `beyond` noise as much as chance makes is
    /// taken off.
    fn own_share(&self, record: &Record, count: f32, beyond: Rgb, by_noise: Rgb) -> f32 {
        let by_chance = by_noise * CHANCE * (2.0 / (count - 2.0).max(1.0)).sqrt();
        let off = (beyond - by_chance).max(Rgb::ZERO).element_sum();
        // Noise of one ray, over the rays of the record.
        let noise = (self.noise_energy / self.per_ray).element_sum() / record.rays.max(1) as f32;
        if off > 0.0 { off / (off + noise) } else { 0.0 }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::{Numbers, Stream};

    /// The fit of the middle one of 81 records, whose irradiance is that of `exact` at their place with
    /// noise of that standard deviation, of which `split` knows.
    fn fit(exact: impl Fn(f32) -> f32, deviation: f32) -> FittedIrradiance {
        let mut numbers = Numbers::new(3, Stream::Gather, 0);
        let mut uniform = || (numbers.uniform() - 0.5) * 12f32.sqrt() * deviation;
        let record = |index: u32| {
            let at = Vec3::new((index % 9) as f32 - 4.0, (index / 9) as f32 - 4.0, 0.0);
            let mut record = Record::new(at, Vec3::Z, 1.0, index);
            record.radius = 4.0;
            record.rays = 100;
            let per_ray = record.rays as f32 / std::f32::consts::PI;
            record.sum = Rgb::splat(exact(at.x) + uniform()) * per_ray;
            record.split = Rgb::splat(uniform()) * per_ray;
            record
        };
        let records: Vec<Record> = (0..81).map(record).collect();
        let own = |record: &Record| [record.irradiance(), record.noise()];
        let mut plane = RecordPlane::new();
        for other in &records {
            plane.add(&records[40], (other, own(other)), other.rays as f32);
        }
        plane.fit(&records[40], own(&records[40]))
    }

    /// Where light is linear, noise is averaged; where it is bent, a record without noise is believed.
    #[test]
    fn records_are_believed_where_light_is_bent() {
        let linear = fit(|x| 10.0 + 0.2 * x, 0.5);
        assert!((linear.value.x - 10.0).abs() < 0.15, "{}", linear.value.x);
        assert!(linear.bent.x < 0.1, "{}", linear.bent.x);
        let peak = |x: f32| if x == 0.0 { 12.0 } else { 10.0 };
        let exact = fit(peak, 0.0);
        assert!((exact.value.x - 12.0).abs() < 1e-3, "{}", exact.value.x);
        // Only what is interpolated is off then.
        assert!(exact.between.x > 0.0 && exact.bent.x - exact.between.x < 1e-6 * exact.bent.x);
        let noisy = fit(peak, 3.0);
        assert!((noisy.value.x - 10.0).abs() < 1.0, "{}", noisy.value.x);
    }
}
