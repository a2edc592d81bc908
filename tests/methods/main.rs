//! Methods: structures, builds, traversals, triangle tests and packets, against the twin, exact answers and each other.

#[path = "../common/mod.rs"]
mod common;

mod accel;
mod all_hits;
mod builds;
mod closed;
mod crossings;
mod distance;
mod exact;
mod front;
mod intersect;
mod lists;
mod math;
mod packets;
mod rounded_packets;
mod same_answers;
mod sorted;
mod stop;
mod streams;
mod stress;
mod structures;
mod table;
mod traverse;
mod work;
