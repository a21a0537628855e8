//! The switches of the paper's algorithm, as variants to measure.

/// One way to run the method.
#[derive(Clone, Debug)]
pub struct Variant {
    /// Name in tables and charts.
    pub name: String,
    /// Options over the base.
    pub options: Vec<(&'static str, String)>,
    /// Whether the mean over many shots is the solution, so that the error falls with the square
    /// root of the shots.
    pub converges: bool,
}

impl Variant {
    /// Whether it computes something for every patch before the first shot, which takes far
    /// longer than the shots in scenes of many patches.
    pub fn starts_slowly(&self) -> bool {
        self.option("constant_radiance") == Some("corrected")
    }
}

impl Variant {
    /// A variant that converges.
    pub fn new(name: &str, options: &[(&'static str, &str)]) -> Self {
        let options = options.iter().map(|(name, value)| (*name, (*value).to_string())).collect();
        Self { name: name.into(), options, converges: true }
    }

    /// A variant with a part of its error that more shots of the same job don't take away, or
    /// that depends on the length of the job.
    pub fn stuck(name: &str, options: &[(&'static str, &str)]) -> Self {
        Self { converges: false, ..Self::new(name, options) }
    }

    fn option(&self, wanted: &str) -> Option<&str> {
        self.options.iter().find(|(name, _)| *name == wanted).map(|(_, value)| value.as_str())
    }

    fn is_paper(&self) -> bool {
        self.option("preset") == Some("paper")
    }

    /// Whether it is the algorithm as printed, with the hemicube resolution of the preset.
    pub fn is_printed(&self) -> bool {
        self.is_paper() && self.option("hemicube_resolution").is_none()
    }

    /// Shots K of one iteration.
    pub fn shots_per_iteration(&self) -> u64 {
        let default = if self.is_paper() { 1 } else { 8 };
        self.option("shots_per_iteration").and_then(|k| k.parse().ok()).unwrap_or(default)
    }

    /// Whether each patch's value is shown flat.
    pub fn is_flat(&self) -> bool {
        let default = if self.is_paper() { "flat" } else { "smooth" };
        self.option("reconstruction").unwrap_or(default) == "flat"
    }
}

/// Variants that are shown in one chart, with what they are compared with first.
pub struct Group {
    /// Short name, for files.
    pub name: &'static str,
    /// The variants.
    pub variants: Vec<Variant>,
}

/// What all others are compared with: the defaults.
pub fn plain() -> Variant {
    Variant::new("plain", &[])
}

/// One switch at a time, grouped by what it changes. `plain` is not repeated.
pub fn switches() -> Vec<Group> {
    let sampling = vec![
        Variant::new("uniform selection", &[("shooter_selection", "uniform")]),
        Variant::new("unstratified", &[("stratified", "false")]),
        Variant::stuck("centre point", &[("shooter_point", "centre")]),
        Variant::stuck("azimuth fixed", &[("random_azimuth", "false")]),
        Variant::stuck("no jitter", &[("subpixel_jitter", "false")]),
    ];
    let iteration = vec![
        Variant::new("K = 1", &[("shots_per_iteration", "1")]),
        Variant::new("K = 4", &[("shots_per_iteration", "4")]),
        Variant::new("K = 16", &[("shots_per_iteration", "16")]),
        Variant::new("burn-in 8", &[("burn_in", "8")]),
    ];
    let faces = vec![
        Variant::new("faces: specular", &[("hemicube_faces", "specular")]),
        Variant::new("faces: top and side", &[("hemicube_faces", "top_and_side")]),
        Variant::new("faces: randomised", &[("hemicube_faces", "randomised")]),
    ];
    let reduction = vec![
        Variant::stuck("zero", &[("variance_reduction", "zero")]),
        Variant::stuck("mean", &[("variance_reduction", "mean")]),
        Variant::stuck(
            "zero, growing M",
            &[("variance_reduction", "zero"), ("variance_reduction_shots", "growing")],
        ),
        Variant::stuck(
            "mean, growing M",
            &[("variance_reduction", "mean"), ("variance_reduction_shots", "growing")],
        ),
    ];
    let constant = vec![
        Variant::stuck("constant: printed", &[("constant_radiance", "printed")]),
        Variant::new("constant: corrected", &[("constant_radiance", "corrected")]),
        // Shot by shot exact on the average, but a job keeps the noise of its first shots.
        Variant::stuck("first shot", &[("first_shot", "true")]),
        Variant::stuck(
            "first shot + corrected",
            &[("first_shot", "true"), ("constant_radiance", "corrected")],
        ),
        Variant::stuck("paper, R = 128", PAPER),
    ];
    [
        ("sampling", sampling),
        ("iteration", iteration),
        ("faces", faces),
        ("reduction", reduction),
        ("constant", constant),
    ]
    .map(|(name, variants)| Group { name, variants })
    .into()
}

/// The paper's algorithm with smaller hemicubes, turned and jittered so that their coarser pixels
/// don't show.
const PAPER: &[(&str, &str)] = &[
    ("preset", "paper"),
    ("hemicube_resolution", "128"),
    ("random_azimuth", "true"),
    ("subpixel_jitter", "true"),
];

/// The same without the extras that [`paper_extras`] and [`paper_reductions`] add one by one:
/// single independent shots, flat pictures, all faces.
const BARE: &[(&str, &str)] = &[
    ("preset", "paper"),
    ("hemicube_resolution", "128"),
    ("random_azimuth", "true"),
    ("subpixel_jitter", "true"),
    ("hemicube_faces", "all"),
    ("variance_reduction", "none"),
    ("constant_radiance", "off"),
];

fn bare_with(name: &str, changes: &[(&'static str, &'static str)]) -> Variant {
    let mut variant = Variant::new(name, BARE);
    for (option, value) in changes {
        variant.options.retain(|(name, _)| name != option);
        variant.options.push((option, (*value).into()));
    }
    variant
}

/// Section 3: what face randomisation and the constant radiance step gain over the bare method.
pub fn paper_extras() -> Vec<Variant> {
    vec![
        bare_with("bare", &[]),
        bare_with("faces: specular", &[("hemicube_faces", "specular")]),
        bare_with("faces: top and side", &[("hemicube_faces", "top_and_side")]),
        bare_with("faces: randomised", &[("hemicube_faces", "randomised")]),
        bare_with("constant: printed", &[("constant_radiance", "printed")]),
        bare_with("constant: corrected", &[("constant_radiance", "corrected")]),
    ]
}

/// Section 2.5: bias against noise, at the M of the run.
pub fn paper_reductions() -> Vec<Variant> {
    vec![
        bare_with("none", &[]),
        bare_with("zero", &[("variance_reduction", "zero")]),
        bare_with("mean", &[("variance_reduction", "mean")]),
    ]
}

/// Section 2.5 with an M that is not the length of the run.
pub fn fixed_m(values: &[u64]) -> Vec<Variant> {
    let mut variants = vec![bare_with("none", &[])];
    for rule in ["zero", "mean"] {
        for m in values {
            let mut variant =
                bare_with(&format!("{rule}, M = {m}"), &[("variance_reduction", rule)]);
            variant.options.push(("variance_reduction_shots", m.to_string()));
            variants.push(variant);
        }
    }
    variants
}

/// The algorithm exactly as printed, hemicubes of 600 × 600 pixels; and without the part of it
/// that needs a closed scene.
pub fn printed() -> Vec<Variant> {
    let without = [("preset", "paper"), ("constant_radiance", "off")];
    vec![
        Variant::stuck("as printed", &[("preset", "paper")]),
        Variant::stuck("without the constant term", &without),
    ]
}

/// What a picture's true error comes from: patches and their reconstruction.
pub fn discretisations() -> Vec<Variant> {
    let mut variants = Vec::new();
    for (words, rule) in [("smooth", "smooth"), ("flat", "flat")] {
        for patches in ["4000", "16000"] {
            let name = format!("{words}, {patches} patches");
            variants.push(Variant::new(&name, &[("reconstruction", rule), ("patches", patches)]));
        }
    }
    variants.push(Variant::stuck("paper, R = 128", PAPER));
    variants
}

#[cfg(test)]
mod tests {
    use super::*;
    use hemilux_engine::transport::settings;
    use std::collections::BTreeMap;

    #[test]
    fn every_variant_is_accepted_and_named_once() {
        let mut names = std::collections::BTreeSet::from([plain().name]);
        let switches: Vec<Variant> = switches().into_iter().flat_map(|g| g.variants).collect();
        for variant in &switches {
            assert!(names.insert(variant.name.clone()), "{} twice", variant.name);
        }
        let all = [
            switches,
            printed(),
            paper_extras(),
            paper_reductions(),
            fixed_m(&[64]),
            discretisations(),
        ];
        for variant in all.iter().flatten() {
            let options: BTreeMap<String, String> =
                variant.options.iter().map(|(n, v)| ((*n).into(), v.clone())).collect();
            let in_force = settings("stochastic", &options);
            let in_force = in_force.unwrap_or_else(|e| panic!("{variant:?}: {e}"));
            let k = variant.shots_per_iteration().to_string();
            assert_eq!(in_force["shots_per_iteration"], k, "{variant:?}");
            assert_eq!(in_force["reconstruction"] == "flat", variant.is_flat(), "{variant:?}");
        }
    }
}
