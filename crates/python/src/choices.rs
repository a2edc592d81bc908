//! What is chosen of a tracer: device, method and more.

use crate::run::Current;
use raybrook::{Error, Precision, Result, Scene, Tracer};

/// What is chosen of a tracer.
#[derive(Clone)]
pub struct Choices {
    device: Option<String>,
    method: Option<String>,
    precision: Option<Precision>,
    memory_limit: Option<u64>,
    cache: bool,
    fall_back: bool,
}

/// The choices as Python has them: device, method, precision, limit of memory, whether the cache is used, and whether
/// the reference goes on where the device is lost.
pub type GivenChoices = (Option<String>, Option<String>, Option<String>, Option<u64>, bool, bool);

impl Choices {
    pub fn new((device, method, precision, memory_limit, cache, fall_back): GivenChoices) -> Result<Choices> {
        let precision = match precision.as_deref() {
            None => None,
            Some("exact") => Some(Precision::Exact),
            Some("fast") => Some(Precision::Fast),
            Some(other) => return Err(Error::option("precision", format!("'{other}' is neither 'exact' nor 'fast'"))),
        };
        Ok(Choices { device, method, precision, memory_limit, cache, fall_back })
    }

    /// Opens a tracer, which tells its progress to the call that is current.
    pub fn open(&self, scene: &Scene, current: Current) -> Result<Tracer> {
        let mut builder = Tracer::builder(scene).cache(self.cache).fall_back(self.fall_back);
        builder = builder.progress(move |done| current.told(done));
        if let Some(device) = &self.device {
            builder = builder.device(device);
        }
        if let Some(method) = &self.method {
            builder = builder.method(method);
        }
        if let Some(precision) = self.precision {
            builder = builder.precision(precision);
        }
        if let Some(bytes) = self.memory_limit {
            builder = builder.memory_limit(bytes);
        }
        builder.build()
    }
}
