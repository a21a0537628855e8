//! Every setting by name, with its default and what it means, and the presets that set several.

/// One setting.
#[derive(Clone, Copy, Debug)]
pub struct OptionSpec {
    /// Name in `options` and after `--set`.
    pub name: &'static str,
    /// Default value.
    pub default: &'static str,
    /// What it does, with unit and range.
    pub meaning: &'static str,
}

/// Every setting.
pub const OPTIONS: &[OptionSpec] = &[
    OptionSpec {
        name: "adaptive",
        default: "true",
        meaning: "hemilux: gather where the light changes and cast shadow rays where they disagree; otherwise evenly",
    },
    OptionSpec {
        name: "adaptive_contrast",
        default: "0.3",
        meaning: "rays, pixel_sampling adaptive: a pixel's cells whose samples differ by more than this contrast |a−b|/(a+b) are split, 0 to 1",
    },
    OptionSpec {
        name: "ambient",
        default: "true",
        meaning: "progressive: show unshot light as an ambient term, π ΔL_mean/(1 − ρ_mean)",
    },
    OptionSpec {
        name: "burn_in",
        default: "0",
        meaning: "iterations left out of the average, 0 to 1000000: L(0) = L^e lacks the higher bounces, a bias of about a²/(M(1−a)) after M iterations",
    },
    OptionSpec {
        name: "coarse_patches",
        default: "auto",
        meaning: "hemilux: wanted number of patches of the coarse mesh that gathers look at, 1 to 1000000; auto: 10000 to 30000, by the limits; at least one a triangle side",
    },
    OptionSpec {
        name: "coarse_rays",
        default: "16",
        meaning: "hemilux: rays of a patch in each iteration, 4 to 4096",
    },
    OptionSpec {
        name: "constant_radiance",
        default: "off",
        meaning: "off, printed or corrected: iterate on ΔL = L − L̄ only, with the source L^e + (a−1)L̄ (printed: closed scenes only) or L^e + (a·V_i−1)L̄, V_i = Σ_j F_ij (corrected)",
    },
    OptionSpec {
        name: "first_shot",
        default: "false",
        meaning: "shoot the direct light of the emitters once beforehand and iterate on the rest",
    },
    OptionSpec {
        name: "form_factor_points",
        default: "1",
        meaning: "gauss-seidel: hemicubes a patch whose mean is its row of form factors, 1 to 64; one stands on the centroid",
    },
    OptionSpec {
        name: "gather",
        default: "true",
        meaning: "hemilux: gather indirect light at records on what the camera sees; otherwise it is shown as the coarse mesh has it",
    },
    OptionSpec {
        name: "gather_direct",
        default: "true",
        meaning: "hemilux: find the direct light afresh where gather rays end; otherwise it is as the coarse mesh has it",
    },
    OptionSpec {
        name: "gather_fit",
        default: "true",
        meaning: "hemilux: let each record hear its neighbours by a local linear fit",
    },
    OptionSpec {
        name: "gather_rays",
        default: "64",
        meaning: "hemilux: rays of a record in each iteration, 4 to 65536; fewer in the first ones where their noise is small",
    },
    OptionSpec {
        name: "hemicube_faces",
        default: "all",
        meaning: "all; specular: one face of highly specular shooters, by probability .6 the one that the mirror direction hits, .1 each other; top_and_side: the top and one of four sides; randomised: one face of highly specular shooters, top and one side of others. Weighted by 1/probability",
    },
    OptionSpec {
        name: "hemicube_resolution",
        default: "256",
        meaning: "pixels R along the top of the hemicube, even, 8 to 2048",
    },
    OptionSpec {
        name: "light",
        default: "true",
        meaning: "hemilux: direct light per pixel in closed form and by shadow rays; otherwise it is shown as the coarse mesh has it",
    },
    OptionSpec {
        name: "light_rays",
        default: "auto",
        meaning: "illumination-map: rays from the lights for a pass, 2 to 1048576; auto: as many as the picture has pixels, 4096 to 1048576. For small pictures they are shot for up to 16 passes at once",
    },
    OptionSpec {
        name: "light_sampling",
        default: "area",
        meaning: "rays: area: points of the emissive triangles; disk, rim: each connected group of them as a disk, sampled over its area or along its edge, its centre weighted by cosⁿθ and the random points by 1 − cosⁿθ (Lange; biased)",
    },
    OptionSpec {
        name: "lobe_filter",
        default: "true",
        meaning: "hemilux: neighbouring pixels share the rays of glossy lobes, as far as the lobes blur what they show",
    },
    OptionSpec {
        name: "map_texels",
        default: "1000000",
        meaning: "illumination-map: wanted number of cells of the map, 1 to 16777216; at least one a diffuse triangle side, more where caustics are",
    },
    OptionSpec {
        name: "near_field",
        default: "true",
        meaning: "hemilux: where a gather ray ends nearer than two sides of a patch, look on by another ray; otherwise take the patch's mean",
    },
    OptionSpec {
        name: "patches",
        default: "16000",
        meaning: "wanted number of surface patches, 1 to 4000000; at least one a triangle side",
    },
    OptionSpec {
        name: "path_strata",
        default: "true",
        meaning: "rays, pixel_sampling jittered with one ray a pixel: the light samples and directions of a pixel's paths at their first two surfaces are spread over as many cells as its samples are",
    },
    OptionSpec {
        name: "pixel_samples",
        default: "16",
        meaning: "sub-pixel samples of the picture, 1 to 256; of rays: cells of a jittered pixel, one a pass, or most samples of an adaptive one in each pass; of hemilux: unless it is set, 16 to 64 by the limits, and at most 64",
    },
    OptionSpec {
        name: "pixel_sampling",
        default: "jittered",
        meaning: "rays: independent; jittered: stratified; adaptive: Dippé's adaptive rectangular jitter, biased as samples that decide about splits are kept; adaptive_fresh: the same cells with new samples, unbiased",
    },
    OptionSpec {
        name: "preset",
        default: "default",
        meaning: "default, or paper: what is not set otherwise is as Antal et al. print it",
    },
    OptionSpec {
        name: "random_azimuth",
        default: "true",
        meaning: "turn each hemicube about its normal by a random angle",
    },
    OptionSpec {
        name: "ray_depth",
        default: "0",
        meaning: "rays: most reflections of a path, 1 to 1000000: 1 is direct light only; 0 is no limit",
    },
    OptionSpec {
        name: "ray_preset",
        default: "default",
        meaning: "rays: default, or lange: what is not set otherwise is as Lange's importance sampling has it",
    },
    OptionSpec {
        name: "rays_per_pixel",
        default: "1",
        meaning: "rays N that leave the first surface, 1 to 4096: kd·N/(kd+ks) by the cosine, ks·N/(kd+ks) by the Phong lobe, and N light samples; each goes on as one path",
    },
    OptionSpec {
        name: "reconstruction",
        default: "smooth",
        meaning: "smooth: local linear fits through the patches' values; flat: each patch shows its value",
    },
    OptionSpec {
        name: "shadow_filter",
        default: "true",
        meaning: "hemilux: neighbouring pixels share shadow rays while these are few",
    },
    OptionSpec {
        name: "shooter_point",
        default: "random",
        meaning: "random: uniform over the patch; centre: its centroid, which is biased",
    },
    OptionSpec {
        name: "shooter_selection",
        default: "power",
        meaning: "power: p_j ∝ Φ_j = Φ^e_j + A_j E_j a(ω'_j), importance sampling; uniform: p_j = 1/N",
    },
    OptionSpec {
        name: "shots_per_iteration",
        default: "8",
        meaning: "shots K of one iteration, 1 to 64",
    },
    OptionSpec {
        name: "stratified",
        default: "true",
        meaning: "pick the K shooters of an iteration by systematic sampling, not independently",
    },
    OptionSpec {
        name: "subpixel_jitter",
        default: "true",
        meaning: "move each hemicube's rays by a random fraction of a pixel",
    },
    OptionSpec {
        name: "variance_reduction",
        default: "none",
        meaning: "none, zero or mean: where p_j < F_{Ai→Aj}/(2M), leave the transfer out or put its expectation in its place; biased, asymptotically right",
    },
    OptionSpec {
        name: "variance_reduction_shots",
        default: "auto",
        meaning: "M, shots of the whole run, 1 to 10^12; growing: the shots so far; auto: the iteration limit times K where there is one, else growing",
    },
    OptionSpec {
        name: "well_spread",
        default: "true",
        meaning: "hemilux: draw points from well-spread sequences; otherwise plain random numbers",
    },
];

/// What the paper prints, where it differs from the defaults.
const PAPER: &[(&str, &str)] = &[
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
];

/// Lange's importance sampling, as Rogers describes it.
const LANGE: &[(&str, &str)] = &[("light_sampling", "disk"), ("rays_per_pixel", "40")];

/// Values that a setting brings with it: name, value, what that sets.
pub type Preset = (&'static str, &'static str, &'static [(&'static str, &'static str)]);
pub const PRESETS: &[Preset] = &[("preset", "paper", PAPER), ("ray_preset", "lange", LANGE)];
