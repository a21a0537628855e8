//! How the bright patches that gather rays are aimed at look from one place. A record sends many rays from
//! about the same place: it can afford to weigh every patch by what that sends there, which a walk down a
//! tree of bounds tells less well.

use super::guide::{Aim, Guide, Met};
use crate::emitters::LightBounds;
use glam::Vec3;

/// Most patches that are weighed one by one; the tree of all picks where there are more.
const MOST_WEIGHED: usize = 2048;

/// Bright patches as seen from a place of a surface.
pub struct Outlook<'a> {
    guide: &'a Guide,
    /// Unit normal of the surface.
    normal: Vec3,
    /// Share of each patch and of those before it in what all send there if nothing stands between;
    /// none where there are too many of them.
    cumulative: Vec<f32>,
}

impl<'a> Outlook<'a> {
    /// From around `point` of a surface with that unit normal.
    pub fn new(guide: &'a Guide, point: Vec3, normal: Vec3) -> Self {
        let bounds = guide.bounds();
        let mut cumulative = Vec::new();
        if bounds.len() <= MOST_WEIGHED {
            let mut sum = 0.0f32;
            cumulative.extend(bounds.iter().map(|bound| {
                sum += sent(bound, point, normal);
                sum
            }));
            let per_sum = if sum > 0.0 { 1.0 / sum } else { 0.0 };
            cumulative.iter_mut().for_each(|share| *share *= per_sum);
        }
        Self { guide, normal, cumulative }
    }

    /// Aims from `point`, close by, by three uniform numbers; `None` where that has missed.
    pub fn aim(&self, point: Vec3, xi: Vec3) -> Option<Aim> {
        if self.cumulative.is_empty() {
            return self.guide.aim(point, self.normal, xi);
        }
        let pick = self.cumulative.partition_point(|share| *share <= xi.x);
        let is_any = pick < self.cumulative.len();
        is_any.then(|| self.guide.towards(pick, point, self.normal, [xi.y, xi.z])).flatten()
    }

    /// Density per solid angle at which [`Outlook::aim`] picks a place of a patch, as
    /// [`Guide::density`] says it of the tree.
    pub fn density(&self, point: Vec3, met: &Met) -> f32 {
        if self.cumulative.is_empty() {
            return self.guide.density(point, self.normal, met);
        }
        let Some(number) = self.guide.number(met.patch) else { return 0.0 };
        let before = number.checked_sub(1).map_or(0.0, |before| self.cumulative[before]);
        self.guide.density_of(number, self.cumulative[number] - before, met)
    }
}

/// What a patch sends to a surface at `point` with that unit normal if nothing stands between, up to a
/// factor that is the same for all; more than nothing as long as part of the ball around the patch is
/// before the surface, and the point before the farthest plane through the ball.
fn sent(bound: &LightBounds, point: Vec3, normal: Vec3) -> f32 {
    let LightBounds { center, radius, power, .. } = *bound;
    let between = center - point;
    let square = between.length_squared().max(radius * radius).max(f32::MIN_POSITIVE);
    let received = (normal.dot(between) + radius).max(0.0);
    let emitted = (radius - bound.normal.dot(between)).max(0.0);
    power * received * emitted / (square * square)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::rays::Eye;
    use crate::scene::made;
    use crate::transport::hemilux::specimen::Specimen;

    /// One over the density at which places are picked, over all that are: the solid angle of all
    /// bright patches that are seen, by either way to pick, within 3 %.
    #[test]
    fn densities_are_those_of_the_picks() {
        let house = made::real::window();
        let specimen = Specimen::surrounded(&house.glb, house.environment, 4000);
        let guide = specimen.coarse.guide.as_ref().expect("the patch of sun is bright");
        assert!(guide.bounds().len() <= MOST_WEIGHED);
        let world = &specimen.world;
        let point = world.rays.place(Vec3::new(0.01, 1.2, 1.5));
        let weighed = Outlook::new(guide, point, Vec3::X);
        let by_tree = Outlook { guide, normal: Vec3::X, cumulative: Vec::new() };
        let angle = |outlook: &Outlook<'_>, damage: f32| {
            let one = |k: u32| {
                let xi = Vec3::new(0.754_877_7, 0.569_840_3, 0.438_579_4) * k as f32;
                let Some(aim) = outlook.aim(point, xi.fract()) else { return 0.0 };
                let Some(hit) = world.rays.closest(Eye::Light, point, aim.direction) else {
                    return 0.0;
                };
                if specimen.coarse.mesh.patch_at(&hit) != Some(aim.patch) {
                    return 0.0;
                }
                let cosine = world.rays.spot(&hit).normal.dot(aim.direction);
                let met = Met { patch: aim.patch, distance: hit.distance, cosine };
                f64::from(damage / outlook.density(point, &met))
            };
            (0..20_000).map(one).sum::<f64>() / 20_000.0
        };
        let (one, other) = (angle(&weighed, 1.0), angle(&by_tree, 1.0));
        assert!(one > 0.0 && (one / other - 1.0).abs() < 0.03, "{one} beside {other}");
        let damaged = angle(&weighed, 1.1);
        assert!((damaged / other - 1.0).abs() > 0.03, "a wrong density would be found out");
    }
}
