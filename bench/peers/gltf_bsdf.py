"""Mitsuba's BSDF for the materials of glTF 2.0, written after appendix B of its specification.

    dielectric = Lambert · (1 − max F) + F · D · V        metal = F · D · V        mixed by metallic

with GGX for D (α = roughness²), Smith's height-correlated V, and Schlick's F between F0 and F90.
Light is scattered once. Since D · V is common to both, there is one lobe with a mixed F.
"""

import drjit as dr
import mitsuba as mi

LEAST_ALPHA = 1e-3


def slant(alpha, cosine):
    """√(α² sin² + cos²), of which Smith's masking is made."""
    return dr.sqrt(dr.square(alpha) + (1 - dr.square(alpha)) * dr.square(cosine))


def visible_normal(alpha, wi, sample):
    """A microfacet's normal by how much of it is seen (Dupuy and Benyoub 2023)."""
    stretched = dr.normalize(mi.Vector3f(alpha * wi.x, alpha * wi.y, wi.z))
    sin, cos = dr.sincos(2 * dr.pi * sample.x)
    z = (1 - sample.y) * (1 + stretched.z) - stretched.z
    across = dr.safe_sqrt(1 - z * z)
    half = mi.Vector3f(across * cos, across * sin, z) + stretched
    return dr.normalize(mi.Vector3f(alpha * half.x, alpha * half.y, dr.maximum(half.z, 0)))


class GltfSurface(mi.BSDF):
    """`color` and `surface` are textures: base colour, and roughness and metallic in the second and
    third channel; `f0` (three numbers) and `f90` are the dielectric's reflectances."""

    def __init__(self, color, surface, f0, f90):
        super().__init__(mi.Properties())
        self.color, self.surface = color, surface
        self.f0, self.f90 = mi.Color3f([float(x) for x in f0]), float(f90)
        front = mi.BSDFFlags.FrontSide
        self.m_components = [
            mi.BSDFFlags.DiffuseReflection | front,
            mi.BSDFFlags.GlossyReflection | front,
        ]
        self.m_flags = self.m_components[0] | self.m_components[1]

    def model(self, si, active):
        """Diffuse albedo, F0, F90, α."""
        color = self.color.eval(si, active)
        surface = self.surface.eval_3(si, active)
        metallic = surface.z
        alpha = dr.maximum(dr.square(surface.y), LEAST_ALPHA)
        f0 = dr.lerp(self.f0, color, metallic)
        f90 = dr.lerp(mi.Float(self.f90), mi.Float(1), metallic)
        return color * (1 - metallic), f0, f90, alpha

    def lobe_share(self, model, cosine):
        """Share of samples that the lobe gets."""
        diffuse, f0, f90, _ = model
        lobe = dr.mean(f0 + (f90 - f0) * (1 - dr.clip(cosine, 0, 1)) ** 5)
        return lobe / dr.maximum(lobe + dr.mean(diffuse), 1e-8)

    def value_and_pdf(self, model, wi, wo, active):
        """f · cos, and the density of `sample`."""
        diffuse, f0, f90, alpha = model
        cos_i, cos_o = wi.z, wo.z
        active &= (cos_i > 0) & (cos_o > 0)
        half = dr.normalize(wi + wo)
        grazing = (1 - dr.clip(dr.dot(wi, half), 0, 1)) ** 5
        loss = dr.lerp(dr.max(self.f0), mi.Float(self.f90), grazing)
        fresnel = f0 + (f90 - f0) * grazing
        # 1 + (α² − 1) cos², written so that it does not cancel.
        sine_square = dr.square(half.x) + dr.square(half.y)
        spread = sine_square + dr.square(alpha * half.z)
        distribution = dr.square(alpha / spread) * dr.inv_pi
        slants = slant(alpha, cos_i), slant(alpha, cos_o)
        visibility = 0.5 / (cos_o * slants[0] + cos_i * slants[1])
        value = (diffuse * ((1 - loss) * dr.inv_pi) + fresnel * (distribution * visibility)) * cos_o
        share = self.lobe_share(model, cos_i)
        pdf = share * distribution / (2 * (cos_i + slants[0]))
        pdf += (1 - share) * cos_o * dr.inv_pi
        return dr.select(active, value, 0), dr.select(active, pdf, 0)

    def sample(self, ctx, si, sample1, sample2, active=True):
        model = self.model(si, active)
        active &= si.wi.z > 0
        half = visible_normal(model[3], si.wi, sample2)
        glossy = sample1 < self.lobe_share(model, si.wi.z)
        cosine = mi.warp.square_to_cosine_hemisphere(sample2)
        bs = mi.BSDFSample3f()
        bs.wo = dr.select(glossy, mi.reflect(si.wi, half), cosine)
        value, bs.pdf = self.value_and_pdf(model, si.wi, bs.wo, active)
        bs.eta = 1.0
        bs.sampled_component = dr.select(glossy, mi.UInt32(1), mi.UInt32(0))
        kinds = mi.BSDFFlags.GlossyReflection, mi.BSDFFlags.DiffuseReflection
        bs.sampled_type = dr.select(glossy, *(mi.UInt32(int(kind)) for kind in kinds))
        active &= bs.pdf > 0
        return bs, dr.select(active, value / bs.pdf, 0)

    def eval(self, ctx, si, wo, active=True):
        return self.eval_pdf(ctx, si, wo, active)[0]

    def pdf(self, ctx, si, wo, active=True):
        return self.eval_pdf(ctx, si, wo, active)[1]

    def eval_pdf(self, ctx, si, wo, active=True):
        return self.value_and_pdf(self.model(si, active), si.wi, wo, active)

    def eval_diffuse_reflectance(self, si, active=True):
        """What a denoiser is told of the surface: its colour, whether it is metal or not."""
        diffuse, f0, _, _ = self.model(si, active)
        return diffuse + f0

    def to_string(self):
        return "GltfSurface[]"
