// Structures that several kernels read; the host side is in layout.rs.

const PI = 3.14159265358979;
const TAU = 6.28318530717959;
const NO_PATCH = 0xffffffffu;
// In place of the back's first patch: the back is never seen, skip the facet.
const CULLED_BACK = 0xfffffffeu;
const NOT_GLOSSY = 0xffffffffu;
const FACES = 5u;

// Bits of Settings.flags.
const RANDOM_AZIMUTH = 1u;
const JITTER = 2u;
const VIEWER_IS_POINT = 4u;
const VIEWER_IS_DIRECTION = 8u;
// Whether per-pixel lobe sums exist: some patch is glossy.
const LOBES = 16u;
const UNIFORM_SELECTION = 32u;
const STRATIFIED = 64u;
const RANDOM_POINT = 128u;
// Whether M of the variance reduction is the number of shots so far.
const GROWING_SHOTS = 256u;

// Settings.faces.
const ALL_FACES = 0u;
const SPECULAR_ONE_FACE = 1u;
const TOP_AND_SIDE = 2u;
const RANDOMISED_FACES = 3u;

// Settings.substitute.
const NO_SUBSTITUTE = 0u;
const SUBSTITUTE_ZERO = 1u;
const SUBSTITUTE_MEAN = 2u;

struct Settings {
    seed: vec2<u32>,
    flags: u32,
    // R of the hemicube.
    resolution: u32,
    patches: u32,
    facets: u32,
    glossy: u32,
    // K.
    shots: u32,
    // Runs of patches and groups of runs in the prefix sum over powers.
    runs: u32,
    groups: u32,
    // Runs of facets in culling.
    facet_runs: u32,
    // Hemicubes side by side in the atlas.
    columns: u32,
    // Which faces are shot through.
    faces: u32,
    // What stands in for transfers that the variance reduction leaves out.
    substitute: u32,
    // M of the variance reduction.
    expected_shots: f32,
    spare: u32,
    // Camera's eye or the direction towards it.
    viewer: vec3<f32>,
    // Depth value at axis distance 1: smaller than any distance in the scene.
    near: f32,
    // Four entries each of radiometry::LobeAlbedo.
    lobe_albedo: array<vec4<f32>, 289>,
}

// The shots of an iteration that share a render pass.
struct Pass {
    first: u32,
    count: u32,
    // Whether these are the first and the last of the iteration.
    opens: u32,
    closes: u32,
}

struct Shot {
    position: vec3<f32>,
    patch_index: u32,
    tangent: vec3<f32>,
    exponent: f32,
    bitangent: vec3<f32>,
    // A_j/(p_j K); 0 where nothing is shot.
    scale: f32,
    normal: vec3<f32>,
    has_lobe: u32,
    // Without the known part of the light.
    diffuse: vec3<f32>,
    // Fixed-point units per form factor in the sums of this shot.
    fixed_scale: f32,
    lobe: vec3<f32>,
    jitter_x: f32,
    lobe_axis: vec3<f32>,
    jitter_y: f32,
    face_weights: vec4<f32>,
    last_face_weight: f32,
    // The variance reduction replaces transfers whose form factor back to the shooter is larger.
    limit: f32,
    // Known part of the radiance.
    known: vec3<f32>,
}

struct Patch {
    centroid: vec3<f32>,
    area: f32,
    normal: vec3<f32>,
    exponent: f32,
    shading_normal: vec3<f32>,
    facet: u32,
    diffuse: vec3<f32>,
    // Index among the glossy patches.
    glossy: u32,
    specular: vec3<f32>,
    // 1 where the patch emits by itself.
    emits: u32,
    // Radiance sent by itself: the emission, or settings::sources with known light.
    source: vec3<f32>,
    // What the power has on top for known light that glossy receivers reflect.
    known_power: f32,
    // Known part of the radiance.
    known: vec3<f32>,
    spare: f32,
}

struct Facet {
    corner: vec3<f32>,
    divisions: u32,
    edge_1: vec3<f32>,
    front: u32,
    edge_2: vec3<f32>,
    back: u32,
}

// One face of one hemicube: rows of the matrix that takes a point relative to the eye to clip
// space. 256 bytes, the alignment of dynamic uniforms.
struct View {
    clip_x: vec3<f32>,
    weight: f32,
    clip_y: vec3<f32>,
    near: f32,
    clip_w: vec3<f32>,
    spare: f32,
    @size(208) eye: vec3<f32>,
}

// State of the iteration that is not per patch.
struct Control {
    // Counts since the host last looked.
    iterations: u32,
    shots: u32,
    light_shots: atomic<u32>,
    spare: u32,
    // Numbers of the next iteration and of its first shot, low word first.
    iteration: vec2<u32>,
    first_shot: vec2<u32>,
    // Where the last iteration's shots came from.
    sources: array<vec4<f32>>,
}

struct Axes {
    axis: vec3<f32>,
    right: vec3<f32>,
    up: vec3<f32>,
}

// hemicube::Face::axes in world space.
fn face_axes(face: u32, tangent: vec3<f32>, bitangent: vec3<f32>, normal: vec3<f32>) -> Axes {
    switch face {
        case 0u: { return Axes(normal, tangent, bitangent); }
        case 1u: { return Axes(tangent, bitangent, normal); }
        case 2u: { return Axes(-tangent, -bitangent, normal); }
        case 3u: { return Axes(bitangent, -tangent, normal); }
        default: { return Axes(-bitangent, tangent, normal); }
    }
}
