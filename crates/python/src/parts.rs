//! How many rays or points are traced at a time: few where they take long, so that Ctrl-C stops a call within a part of
//! a second. The library tells of its progress within a part, too, but not of all that it does: what it decides on the
//! host, such as hits through vertices, is done for the whole part at once.

use std::time::Duration;

/// A part that took less is followed by a larger one, one that took more by a smaller one.
const SHORT: Duration = Duration::from_millis(100);
const LONG: Duration = Duration::from_millis(300);
/// The first part is so much smaller than the largest, as long as nobody knows how long one takes.
const FIRST: usize = 4;
/// The least part, which still keeps all cores busy.
const LEAST: usize = 1 << 10;

/// The sizes of parts of a call.
pub struct Parts {
    size: usize,
    most: usize,
}

impl Parts {
    pub fn new(most: usize) -> Parts {
        Parts { size: most / FIRST, most }
    }

    /// Of the next part.
    pub fn size(&self) -> usize {
        self.size
    }

    /// Takes note of how long a part of this size took, or a smaller last one.
    pub fn took(&mut self, time: Duration) {
        if time < SHORT {
            self.size = (self.size * 4).min(self.most);
        } else if time > LONG {
            let in_time = self.size as f64 * LONG.as_secs_f64() / time.as_secs_f64();
            self.size = (in_time as usize).clamp(LEAST, self.size);
        }
    }
}
