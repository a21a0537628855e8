//! Settings of stochastic iteration.

use crate::device::{Faces, Selection, ShootingSettings, Substitute};
use crate::transport::known::ConstantRadiance;
use crate::transport::options::{
    AnySetting, Choice, HEMICUBE_RESOLUTION, Preset, SHOTS_PER_ITERATION, Setting, Settings,
    Switch, Whole, WholeOr,
};

static PRESET: Setting<Choice<()>> =
    Setting::new("preset", "default", Choice(&[("default", ()), ("paper", ())]))
        .means("default, or paper: what is not set otherwise is as Antal et al. print it");
static HEMICUBE_FACES: Setting<Choice<Faces>> = Setting::new(
    "hemicube_faces",
    "all",
    Choice(&[
        ("all", Faces::All),
        ("specular", Faces::Specular),
        ("top_and_side", Faces::TopAndSide),
        ("randomised", Faces::Randomised),
    ]),
)
.means("all; specular: one face of highly specular shooters, by probability .6 the one that the mirror direction hits, .1 each other; top_and_side: the top and one of four sides; randomised: one face of highly specular shooters, top and one side of others. Weighted by 1/probability");
static SHOOTER_SELECTION: Setting<Choice<Selection>> = Setting::new(
    "shooter_selection",
    "power",
    Choice(&[("power", Selection::Power), ("uniform", Selection::Uniform)]),
)
.means("power: p_j ∝ Φ_j = Φ^e_j + A_j E_j a(ω'_j), importance sampling; uniform: p_j = 1/N");
static CONSTANT_RADIANCE: Setting<Choice<ConstantRadiance>> = Setting::new(
    "constant_radiance",
    "off",
    Choice(&[
        ("off", ConstantRadiance::Off),
        ("printed", ConstantRadiance::Printed),
        ("corrected", ConstantRadiance::Corrected),
    ]),
)
.means("off, printed or corrected: iterate on ΔL = L − L̄ only, with the source L^e + (a−1)L̄ (printed: closed scenes only) or L^e + (a·V_i−1)L̄, V_i = Σ_j F_ij (corrected)");
static VARIANCE_REDUCTION: Setting<Choice<Option<Substitute>>> = Setting::new(
    "variance_reduction",
    "none",
    Choice(&[("none", None), ("zero", Some(Substitute::Zero)), ("mean", Some(Substitute::Mean))]),
)
.means("none, zero or mean: where p_j < F_{Ai→Aj}/(2M), leave the transfer out or put its expectation in its place; biased, asymptotically right");
static FIRST_SHOT: Setting<Switch> = Setting::new("first_shot", "false", Switch)
    .means("shoot the direct light of the emitters once beforehand and iterate on the rest");

static BURN_IN: Setting<Whole> = Setting::new("burn_in", "0", Whole { low: 0, high: 1_000_000 })
    .unit("iterations")
    .means("iterations left out of the average: L(0) = L^e lacks the higher bounces, a bias of about a²/(M(1−a)) after M iterations")
    .for_studies();
static RANDOM_AZIMUTH: Setting<Switch> = Setting::new("random_azimuth", "true", Switch)
    .means("turn each hemicube about its normal by a random angle")
    .for_studies();
static SHOOTER_POINT: Setting<Choice<bool>> =
    Setting::new("shooter_point", "random", Choice(&[("random", true), ("centre", false)]))
        .means("random: uniform over the patch; centre: its centroid, which is biased")
        .for_studies();
static STRATIFIED: Setting<Switch> = Setting::new("stratified", "true", Switch)
    .means("pick the K shooters of an iteration by systematic sampling, not independently")
    .for_studies();
static SUBPIXEL_JITTER: Setting<Switch> = Setting::new("subpixel_jitter", "true", Switch)
    .means("move each hemicube's rays by a random fraction of a pixel")
    .for_studies();
static VARIANCE_REDUCTION_SHOTS: Setting<WholeOr<ExpectedShots>> = Setting::new(
    "variance_reduction_shots",
    "auto",
    WholeOr {
        low: 1,
        high: 1_000_000_000_000,
        number: ExpectedShots::Given,
        words: &[("auto", ExpectedShots::Auto), ("growing", ExpectedShots::Growing)],
    },
)
.unit("shots")
.means("M, shots of the whole run; growing: the shots so far; auto: the iteration limit times K where there is one, else growing")
.for_studies();

/// Those of the iteration.
pub static SETTINGS: &[&dyn AnySetting] = &[
    &PRESET,
    &HEMICUBE_RESOLUTION,
    &SHOTS_PER_ITERATION,
    &HEMICUBE_FACES,
    &SHOOTER_SELECTION,
    &CONSTANT_RADIANCE,
    &VARIANCE_REDUCTION,
    &FIRST_SHOT,
    &BURN_IN,
    &RANDOM_AZIMUTH,
    &SHOOTER_POINT,
    &STRATIFIED,
    &SUBPIXEL_JITTER,
    &VARIANCE_REDUCTION_SHOTS,
];

/// What the paper prints, where it differs from the defaults.
pub static PRESETS: [Preset; 1] = [Preset {
    setting: "preset",
    value: "paper",
    brings: &[
        ("constant_radiance", "printed"),
        ("hemicube_faces", "randomised"),
        ("hemicube_resolution", "600"),
        ("pixel_samples", "1"),
        ("random_azimuth", "false"),
        ("reconstruction", "flat"),
        ("shots_per_iteration", "1"),
        ("stratified", "false"),
        ("subpixel_jitter", "false"),
        ("variance_reduction", "zero"),
    ],
}];

/// Checked settings of stochastic iteration.
#[derive(Clone, Debug)]
pub struct StochasticSettings {
    /// What the device is told; seed, viewer, known light and variance reduction are not yet in.
    pub shooting: ShootingSettings,
    /// Variance reduction, if any.
    pub substitute: Option<Substitute>,
    /// Its M.
    pub substitute_shots: ExpectedShots,
    /// The constant radiance term.
    pub constant: ConstantRadiance,
    /// Whether direct light is shot beforehand.
    pub first_shot: bool,
    /// Iterations left out of the average.
    pub burn_in: u64,
}

/// M of the variance reduction, in shots.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ExpectedShots {
    /// From the iteration limit, else as [`ExpectedShots::Growing`].
    Auto,
    /// The shots so far.
    Growing,
    /// This many.
    Given(u64),
}

impl StochasticSettings {
    /// Those in force.
    pub fn new(settings: &Settings) -> Self {
        Self {
            shooting: ShootingSettings {
                resolution: settings.get(&HEMICUBE_RESOLUTION) as u32,
                shots_per_iteration: settings.get(&SHOTS_PER_ITERATION) as u32,
                selection: settings.get(&SHOOTER_SELECTION),
                stratified: settings.get(&STRATIFIED),
                random_point: settings.get(&SHOOTER_POINT),
                random_azimuth: settings.get(&RANDOM_AZIMUTH),
                jitter: settings.get(&SUBPIXEL_JITTER),
                faces: settings.get(&HEMICUBE_FACES),
                ..ShootingSettings::default()
            },
            substitute: settings.get(&VARIANCE_REDUCTION),
            substitute_shots: settings.get(&VARIANCE_REDUCTION_SHOTS),
            constant: settings.get(&CONSTANT_RADIANCE),
            first_shot: settings.get(&FIRST_SHOT),
            burn_in: settings.get(&BURN_IN),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::transport::solver::Method;
    use crate::transport::stochastic::Stochastic;

    #[test]
    fn the_paper_is_a_preset_that_can_be_overridden() {
        let read = |given: &[(&str, &str)]| {
            let given = given.iter().map(|(name, value)| (name.to_string(), value.to_string()));
            let settings = Settings::new(&Stochastic.scope(), &given.collect()).expect("right");
            StochasticSettings::new(&settings)
        };
        let paper = read(&[("preset", "paper")]);
        assert_eq!((paper.shooting.resolution, paper.shooting.shots_per_iteration), (600, 1));
        assert_eq!(paper.constant, ConstantRadiance::Printed);
        let mixed = read(&[("preset", "paper"), ("hemicube_resolution", "64")]);
        assert_eq!((mixed.shooting.resolution, mixed.shooting.shots_per_iteration), (64, 1));
    }
}
