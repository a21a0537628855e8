//! What lights a picture's fragments, without a ray yet.

use super::super::direct::DirectLighting;
use super::super::fragments::VisibleSurfaces;
use super::super::gloss::Gloss;
use super::super::settings::HemiluxSettings;
use crate::emitters::DirectLights;
use crate::surface::World;

/// Direct light and lobes of the fragments that a camera sees; lobes leave narrow lights to the shadow
/// rays of direct light, if there is any. `hasty` if the first picture had better come soon.
pub(super) fn light_and_lobes(
    (world, lights): (&World, &DirectLights),
    visible: &VisibleSurfaces,
    options: &HemiluxSettings,
    hasty: bool,
) -> (DirectLighting, Gloss) {
    let direct = DirectLighting::new(lights, visible, options.adaptive, hasty);
    let gloss = Gloss::new(world, visible, options.lobe_filter);
    let most = lights.narrow_up_to();
    if !options.light || most.polished <= 0.0 {
        return (direct, gloss);
    }
    let gloss = gloss.without_narrow(world, visible, most);
    (direct.with_highlights(visible, gloss.leaving_narrow(), lights.narrow_count()), gloss)
}
