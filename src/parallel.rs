//! Loops over many things on all cores: in order, in parts, and compiled once.
//!
//! Threads are rayon's, of the current pool. Its own iterators are compiled anew for each loop, some two thousand lines
//! of LLVM's code for one; with a hundred loops that was a quarter of the library. Here rayon sees one loop, over
//! numbers, which calls a function by its address; a loop of ours adds what it does to one part.
//!
//! Results are in order and do not depend on the number of threads, as long as what is merged may be merged in any
//! groups.

use rayon::prelude::*;
use std::mem::MaybeUninit;
use std::ptr;
use std::sync::atomic::{AtomicBool, AtomicU32, Ordering};
use std::sync::{Mutex, MutexGuard, PoisonError};

/// Things that a thread takes at once at most: few enough to share the last ones evenly, many enough that taking them
/// costs nothing beside the cheapest work.
const MOST_OF_PART: usize = 4096;

/// Parts for each thread, where there are few things: some may take much longer than others.
const PARTS_OF_THREAD: usize = 16;

/// Rays that a processor's cores go over at a time, again and again in the same memory, which caches hold. On two
/// cores 8 million camera rays in runs of 2^16 to 2^21 took 0.73, 0.72, 0.60, 0.60, 0.76 and 0.89 of the time that all
/// at once took; on sixteen 4 million in parts of 2^18 to 2^22 29, 23.6, 21.2, 18.2 and 18.6 ms.
pub fn rays_in_caches() -> usize {
    (rayon::current_num_threads() << 17).clamp(1 << 18, 1 << 22)
}

/// How many of `count` things a thread takes at once.
fn part_of(count: usize) -> usize {
    count.div_ceil(PARTS_OF_THREAD * rayon::current_num_threads()).clamp(1, MOST_OF_PART)
}

/// What a mutex has, whatever became of the thread that had it before.
pub fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

/// The same once nobody else has it.
pub fn unlocked<T>(mutex: Mutex<T>) -> T {
    mutex.into_inner().unwrap_or_else(PoisonError::into_inner)
}

/// The loop that rayon runs.
fn each_number(count: usize, work: &(dyn Fn(usize) + Sync)) {
    match count {
        0 => {}
        1 => work(0),
        _ => (0..count).into_par_iter().for_each(work),
    }
}

/// Does `work` with as many other threads, for whose loops nobody else waits; on those that are there where the system
/// has no more.
pub fn on_own_threads<T: Send>(work: impl FnOnce() -> T + Send) -> T {
    match rayon::ThreadPoolBuilder::new().build() {
        Ok(pool) => pool.install(work),
        Err(_) => work(),
    }
}

/// Calls `work` with each of `items`. Each is kept behind a lock until it is taken: items that take less than a
/// microsecond belong together in chunks.
///
/// A thread takes items that are side by side, as far from those of other threads as can be. Where all took the next
/// one, they would touch the same new pages of memory at the same time, and wait for each other.
pub fn each<I: Iterator<Item: Send>>(items: I, work: impl Fn(I::Item) + Sync) {
    let items: Vec<_> = items.map(|item| Mutex::new(Some(item))).collect();
    each_number(items.len(), &|number| {
        let item = lock(&items[number]).take();
        if let Some(item) = item {
            work(item);
        }
    });
}

/// What `work` makes of each of `items`, in their order; they are taken as by [`each()`].
pub fn map<I, T>(items: I, work: impl Fn(I::Item) -> T + Sync) -> Vec<T>
where
    I: ExactSizeIterator<Item: Send>,
    T: Send,
{
    let mut made = Vec::new();
    made.resize_with(items.len(), || None);
    each(items.zip(&mut made), |(item, made)| *made = Some(work(item)));
    made.into_iter().flatten().collect()
}

/// `value` of each number below `count`, in order.
pub fn map_numbers<T: Send>(count: usize, value: impl Fn(usize) -> T + Sync) -> Vec<T> {
    let mut values = Vec::new();
    extend(&mut values, count, value);
    values
}

/// `value` of each of `from`, in order.
pub fn map_slice<F: Sync, T: Send>(from: &[F], value: impl Fn(&F) -> T + Sync) -> Vec<T> {
    map_numbers(from.len(), |i| value(&from[i]))
}

/// Appends `value` of each number below `count`, in order.
pub fn extend<T: Send>(values: &mut Vec<T>, count: usize, value: impl Fn(usize) -> T + Sync) {
    values.reserve(count);
    let (part, before) = (part_of(count), values.len());
    let room: &mut [MaybeUninit<T>] = &mut values.spare_capacity_mut()[..count];
    each(room.chunks_mut(part).enumerate(), |(number, room)| {
        for (i, room) in (number * part..).zip(room) {
            room.write(value(i));
        }
    });
    // SAFETY: room was reserved, and each of the `count` values was written: a panic of `value` does not come here.
    unsafe { values.set_len(before + count) };
}

/// Appends pieces of so many values each, in order; `fill` puts those of a piece, by its number, into its room.
///
/// # Panics
/// When a piece gets fewer values than that.
pub fn extend_by_pieces<T: Copy + Send>(
    values: &mut Vec<T>,
    lengths: &[usize],
    fill: impl Fn(usize, &mut Piece<T>) + Sync,
) {
    let (count, before) = (lengths.iter().sum(), values.len());
    values.reserve(count);
    let mut room: &mut [MaybeUninit<T>] = &mut values.spare_capacity_mut()[..count];
    let pieces = lengths.iter().map(|&length| {
        let (now, later) = std::mem::take(&mut room).split_at_mut(length);
        room = later;
        Piece { room: now }
    });
    each(pieces.enumerate(), |(number, mut piece)| {
        fill(number, &mut piece);
        assert!(piece.room.is_empty(), "piece {number} is not full");
    });
    // SAFETY: room was reserved, and every piece is full.
    unsafe { values.set_len(before + count) };
}

/// What is left of a piece's room.
pub struct Piece<'a, T> {
    room: &'a mut [MaybeUninit<T>],
}

impl<T: Copy> Piece<'_, T> {
    /// Puts values behind those that are there.
    ///
    /// # Panics
    /// When there is no room for them.
    pub fn put(&mut self, values: impl ExactSizeIterator<Item = T>) {
        let length = values.len();
        let (now, later) = std::mem::take(&mut self.room).split_at_mut(length);
        let written = now.iter_mut().zip(values).map(|(room, value)| room.write(value)).count();
        assert_eq!(written, length, "an iterator tells another length than it has");
        self.room = later;
    }
}

/// Room for values that come piece by piece, by several threads and in any order.
pub struct Room<'a, T> {
    pieces: Vec<Mutex<RoomOfPiece<'a, T>>>,
    /// Values of a piece.
    length: usize,
}

struct RoomOfPiece<'a, T> {
    values: &'a mut [MaybeUninit<T>],
    is_full: bool,
}

impl<T: Copy> Room<'_, T> {
    /// Puts values from number `first` on into their places, in place of those that are there.
    pub fn put(&self, first: usize, values: impl ExactSizeIterator<Item = T>) {
        let (mut next, mut values) = (first, values);
        while values.len() > 0 {
            let (room, from) = (&mut *lock(&self.pieces[next / self.length]), next % self.length);
            let count = values.len().min(room.values.len() - from);
            let places = &mut room.values[from..from + count];
            let written = places.iter_mut().zip(&mut values).map(|(place, value)| place.write(value)).count();
            room.is_full |= written == room.values.len();
            next += count;
        }
    }
}

/// `count` values in pieces of so many, which `fill` puts into their room; none unless each whole piece came at once.
pub fn filled<T: Copy + Send, R>(
    (count, length): (usize, usize),
    fill: impl FnOnce(&Room<T>) -> R,
) -> (R, Option<Vec<T>>) {
    let mut values = Vec::with_capacity(count);
    let room: &mut [MaybeUninit<T>] = &mut values.spare_capacity_mut()[..count];
    let pieces = room.chunks_mut(length).map(|values| Mutex::new(RoomOfPiece { values, is_full: false }));
    let room = Room { pieces: pieces.collect(), length };
    let done = fill(&room);
    let is_full = room.pieces.into_iter().all(|piece| unlocked(piece).is_full);
    if !is_full {
        return (done, None);
    }
    // SAFETY: room was reserved, and all values of each piece were written.
    unsafe { values.set_len(count) };
    (done, Some(values))
}

/// Calls `work` with each of `values` and its number.
pub fn each_mut<T: Send>(values: &mut [T], work: impl Fn(usize, &mut T) + Sync) {
    let part = part_of(values.len());
    each(values.chunks_mut(part).enumerate(), |(number, values)| {
        for (i, value) in (number * part..).zip(values) {
            work(i, value);
        }
    });
}

/// What `values` gives for each number below `count`, in order.
pub fn flat_map_numbers<T, V>(count: usize, values: impl Fn(usize) -> V + Sync) -> Vec<T>
where
    T: Send,
    V: IntoIterator<Item = T>,
{
    let parts = map(parts(count), |(from, to)| (from..to).flat_map(&values).collect::<Vec<T>>());
    let mut all = Vec::with_capacity(parts.iter().map(Vec::len).sum());
    parts.into_iter().for_each(|part| all.extend(part));
    all
}

/// `value` of each number below `count`, merged. `nothing` is what changes nothing that it is merged with.
pub fn reduce_numbers<T: Clone + Send + Sync>(
    count: usize,
    nothing: T,
    value: impl Fn(usize) -> T + Sync,
    merge: impl Fn(T, T) -> T + Sync,
) -> T {
    let of_part = |(from, to): (usize, usize)| (from..to).map(&value).fold(nothing.clone(), &merge);
    map(parts(count), of_part).into_iter().fold(nothing.clone(), &merge)
}

/// Numbers are ordered by so many bits at once: the ends of so many buckets stay in a processor's first cache.
const DIGIT_BITS: u32 = 12;
/// The bits of keys that are ordered.
pub const ORDERED_BITS: u32 = 2 * DIGIT_BITS;
/// So many keys are ordered at most: the number of one and a digit are 32 bits.
pub const MOST_ORDERED: usize = 1 << (u32::BITS - DIGIT_BITS);
/// Fewer are one thread's.
const FEWEST_OF_THREAD: usize = 1 << 14;

/// Writes the numbers of `keys` to `order`, those of the lowest key first, and those of equal ones as they come. `room`
/// is memory for as many.
///
/// A radix sort, from the lower digit to the higher.
///
/// # Panics
/// When there are more than [`MOST_ORDERED`], or not as many of each.
pub fn order_by(keys: &[u32], order: &mut [u32], room: &mut [u32]) {
    assert!(keys.len() <= MOST_ORDERED && order.len() == keys.len() && room.len() == keys.len());
    let digits = (1 << DIGIT_BITS) - 1;
    order_by_digit(keys, |key| key & digits, |i, key| (key >> DIGIT_BITS) << (u32::BITS - DIGIT_BITS) | i, room);
    order_by_digit(room, |entry| entry >> (u32::BITS - DIGIT_BITS), |_, entry| entry & (u32::MAX >> DIGIT_BITS), order);
}

/// Writes what `entry` makes of each of `from` and its number, in the order of a `digit` of theirs.
fn order_by_digit(
    from: &[u32],
    digit: impl Fn(u32) -> u32 + Sync,
    entry: impl Fn(u32, u32) -> u32 + Sync,
    to: &mut [u32],
) {
    // Each part counts its digits, and has places for each behind those of the parts before.
    let part = from.len().div_ceil(rayon::current_num_threads()).max(FEWEST_OF_THREAD);
    let mut places = map(from.chunks(part), |from| {
        let mut counts = vec![0u32; 1 << DIGIT_BITS];
        from.iter().for_each(|&one| counts[digit(one) as usize] += 1);
        counts
    });
    let mut end = 0;
    for digit in 0..1 << DIGIT_BITS {
        for places in &mut places {
            end += std::mem::replace(&mut places[digit], end);
        }
    }
    // SAFETY: both are laid out alike, and nobody else has the memory as long as it is borrowed here.
    let to = unsafe { &*(ptr::from_mut(to) as *const [AtomicU32]) };
    each(from.chunks(part).zip(&mut places).enumerate(), |(number, (from, places))| {
        for (i, &one) in ((number * part) as u32..).zip(from) {
            let place = &mut places[digit(one) as usize];
            to[*place as usize].store(entry(i, one), Ordering::Relaxed);
            *place += 1;
        }
    });
}

/// Whether it `is` so with any number below `count`. Stops soon after the first one.
pub fn any_number(count: usize, is: impl Fn(usize) -> bool + Sync) -> bool {
    let is_found = AtomicBool::new(false);
    each(parts(count), |(from, to)| {
        if !is_found.load(Ordering::Relaxed) && (from..to).any(&is) {
            is_found.store(true, Ordering::Relaxed);
        }
    });
    is_found.into_inner()
}

/// Parts of `count` things, each as its first number and its end.
fn parts(count: usize) -> impl ExactSizeIterator<Item = (usize, usize)> {
    let part = part_of(count);
    (0..count.div_ceil(part)).map(move |number| (number * part, count.min((number + 1) * part)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::atomic::AtomicUsize;

    /// Around the sizes of parts, with one thread and with more than there are cores.
    fn everywhere(test: impl Fn(usize) + Sync) {
        for threads in [1, 2, 7] {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            let counts = [0, 1, 2, 31, 1000, MOST_OF_PART * PARTS_OF_THREAD * threads + 1];
            pool.install(|| counts.into_iter().for_each(&test));
        }
    }

    #[test]
    fn values_are_in_order_whatever_the_number_of_threads() {
        everywhere(|count| {
            let expected: Vec<usize> = (0..count).map(|i| 3 * i).collect();
            assert_eq!(map_numbers(count, |i| 3 * i), expected);
            assert_eq!(map(expected.chunks(100), |chunk| chunk.to_vec()).concat(), expected);

            let mut more = vec![7];
            extend(&mut more, count, |i| 3 * i);
            assert_eq!((more[0], &more[1..]), (7, &expected[..]));

            assert_eq!(map_slice(&expected, |i| i + 1), map_numbers(count, |i| 3 * i + 1));
            for wanted in [0, count / 2, count.saturating_sub(1), count] {
                assert_eq!(any_number(count, |i| i == wanted), wanted < count);
            }

            let twice = |i: usize| std::iter::repeat_n(i, i % 3);
            assert_eq!(flat_map_numbers(count, twice), (0..count).flat_map(twice).collect::<Vec<_>>());
            assert_eq!(
                flat_map_numbers(count, |i| (i % 5 == 1).then_some(i)),
                (0..count).skip(1).step_by(5).collect::<Vec<_>>()
            );

            let mut values = vec![1; count];
            each_mut(&mut values, |i, value| *value += i);
            assert_eq!(values, (1..=count).collect::<Vec<_>>());
        });
    }

    #[test]
    fn each_item_is_taken_once_and_merged_in_order() {
        everywhere(|count| {
            let taken: Vec<AtomicUsize> = (0..count).map(|_| AtomicUsize::new(0)).collect();
            each(taken.iter(), |taken| {
                taken.fetch_add(1, Ordering::Relaxed);
            });
            assert!(taken.iter().all(|taken| taken.load(Ordering::Relaxed) == 1));

            let joined = reduce_numbers(count.min(5000), String::new(), |i| format!("{i},"), |a, b| a + &b);
            assert_eq!(joined, (0..count.min(5000)).map(|i| format!("{i},")).collect::<String>());
        });
    }

    #[test]
    fn rooms_are_full_once_all_pieces_have_come() {
        everywhere(|count| {
            let length = 100;
            let starts = || (0..count).step_by(length);
            let values = |first: usize| (first..count.min(first + length)).map(|i| 3 * i);
            let all: Vec<usize> = (0..count).map(|i| 3 * i).collect();
            let put_all = |room: &Room<usize>| each(starts(), |first| room.put(first, values(first)));
            assert_eq!(filled((count, length), put_all).1, Some(all.clone()));
            // Wrong values before the right ones, and several pieces at a time.
            let put_twice = |room: &Room<usize>| {
                room.put(0, (0..count).rev());
                put_all(room);
            };
            assert_eq!(filled((count, length), put_twice).1, Some(all.clone()));
            if count < 2 {
                return;
            }
            // What comes in parts of pieces only takes the place of others.
            let put_halves = |room: &Room<usize>| {
                room.put(0, all[..count / 2].iter().copied());
                room.put(count / 2, all[count / 2..].iter().copied());
            };
            assert_eq!(filled((count, length), put_halves).1.is_some(), (count / 2).is_multiple_of(length));
            let put_wrong_first = |room: &Room<usize>| {
                room.put(0, std::iter::repeat_n(7, count));
                put_halves(room);
            };
            assert_eq!(filled((count, length), put_wrong_first).1, Some(all.clone()));
            let all_but_the_last = |room: &Room<usize>| room.put(0, all[..count - 1].iter().copied());
            assert_eq!(filled((count, length), all_but_the_last).1, None);
        });
    }

    /// Nothing half made is left behind, and later loops go on.
    #[test]
    fn a_panic_comes_back_to_the_caller() {
        let mut values = vec![String::from("before")];
        let result = std::panic::catch_unwind(std::panic::AssertUnwindSafe(|| {
            extend(&mut values, 10_000, |i| if i == 7777 { panic!("at {i}") } else { i.to_string() });
        }));
        let message = result.unwrap_err();
        assert_eq!(message.downcast_ref::<String>().unwrap(), "at 7777");
        assert_eq!(values, ["before"]);
        extend(&mut values, 1, |i| i.to_string());
        assert_eq!(values, ["before", "0"]);
    }

    #[test]
    fn keys_are_ordered_whatever_bits_they_differ_in() {
        everywhere(|count| {
            let mut random = crate::random::Random::new(count as u64);
            for bits in [u32::MAX, 0x00f0_0f00, 7, 1 << (ORDERED_BITS - 1), 0] {
                let keys: Vec<_> = (0..count).map(|_| random.below(1 << ORDERED_BITS) as u32 & bits).collect();
                let mut expected: Vec<_> = (0..count as u32).collect();
                expected.sort_by_key(|&i| keys[i as usize]);
                let (mut order, mut room) = (vec![1; count], vec![2; count]);
                order_by(&keys, &mut order, &mut room);
                assert_eq!(order, expected, "{bits:x}");
            }
        });
    }
}
