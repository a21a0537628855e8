//! Radiosity: the diffuse balance B_i = E_i + ρ_i Σ_j F_ij B_j (Rogers §5-17), solved in three
//! classic ways from the same hemicubes. All in radiance, L = B/π.

mod diffuse;
mod form_factor_matrix;
mod gauss_seidel;
mod monte_carlo;
mod progressive;
mod settings;

pub use gauss_seidel::GaussSeidel;
pub use monte_carlo::MonteCarlo;
pub use progressive::Progressive;
