//! Saves the state of the processor's stochastic iteration in a checkpoint, and restores it.

use super::iterate::State;
use crate::checkpoint::{CheckpointError, Reader, Writer};

/// Tag at the start of the state, “CPU” in ASCII: the processor wrote it, not a GPU.
const CPU: u32 = 0x43_50_55;
/// Upper bound of a plausible count of iterations; a larger one means damaged bytes.
const MOST_ITERATIONS: u64 = 1 << 48;

impl State {
    /// Writes everything but what each iteration makes anew.
    pub fn save(&self, to: &mut Writer) {
        to.value(CPU);
        to.value(self.iteration);
        to.slice(&self.irradiance);
        to.slice(&self.sources);
        to.slice(&self.incoming);
        to.slice(&self.power);
        to.slice(&self.shooters);
        to.value(self.sums.iterations);
        to.slice(&self.sums.irradiance);
        to.slice(&self.sums.glossy);
    }

    /// Takes what [`State::save`] wrote of the same scene and settings.
    pub fn restore(
        &mut self,
        from: &mut Reader<'_>,
        patches: usize,
    ) -> Result<(), CheckpointError> {
        if from.value::<u32>()? != CPU {
            return Err(CheckpointError::foreign("another device, not the processor"));
        }
        self.iteration = from.count(MOST_ITERATIONS)?;
        from.replace(&mut self.irradiance)?;
        from.replace(&mut self.sources)?;
        from.replace(&mut self.incoming)?;
        from.replace(&mut self.power)?;
        self.shooters = from.slice()?;
        if self.shooters.iter().any(|patch| *patch as usize >= patches) {
            return Err(CheckpointError::damaged("there is no such shooter"));
        }
        self.sums.iterations = from.count(self.iteration)?;
        from.replace(&mut self.sums.irradiance)?;
        from.replace(&mut self.sums.glossy)
    }
}
