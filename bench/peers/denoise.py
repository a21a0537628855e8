"""Open Image Denoise, with albedo and normals."""

