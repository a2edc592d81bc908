//! Links of packed hierarchies of boxes to their leaves, the same for two and for eight children a node; the bits are in `bvh2.rs`.

use crate::options::TraceOptions;
use crate::shared::{BVH_COUNT_SHIFT, BVH_FIRST_MASK, BVH_LEAF};
use std::ops::Range;

/// The link to a child that is none: a leaf without triangles.
pub(super) const NO_CHILD: u32 = leaf_link(0, 0);

/// The link to a leaf of `count` triangles, references `first` and following.
pub(super) const fn leaf_link(first: u32, count: u32) -> u32 {
    debug_assert!(count <= TraceOptions::BVH2_MAX_LEAF && first <= BVH_FIRST_MASK);
    BVH_LEAF | count << BVH_COUNT_SHIFT | first
}

/// The references of the leaf that `link` leads to, none of them for [`NO_CHILD`]; `None` for the number of an inner node.
pub(crate) fn leaf_range(link: u32) -> Option<Range<usize>> {
    let (first, count) = (link & BVH_FIRST_MASK, (link & !BVH_LEAF) >> BVH_COUNT_SHIFT);
    (link & BVH_LEAF != 0).then(|| first as usize..(first + count) as usize)
}

/// How many triangles each of the leaves has that some of the `links` lead to.
pub(super) fn leaf_counts(links: impl Iterator<Item = u32>) -> impl Iterator<Item = u32> {
    links.filter_map(leaf_range).map(|leaf| leaf.len() as u32).filter(|&count| count > 0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::shared::BVH_END;

    #[test]
    fn links_to_leaves_come_apart_again() {
        for (first, count) in [(0, 1), (8, 15), (BVH_FIRST_MASK, 1), (BVH_FIRST_MASK - 15, 15)] {
            let link = leaf_link(first, count);
            assert_eq!(leaf_range(link), Some(first as usize..(first + count) as usize));
            assert!(link != BVH_END && link != NO_CHILD);
        }
        assert_eq!(leaf_range(NO_CHILD), Some(0..0));
        assert_eq!([0, 1, BVH_LEAF - 1].map(leaf_range), [None, None, None]);
        let links = [3, leaf_link(0, 7), NO_CHILD, leaf_link(7, 1)];
        assert_eq!(leaf_counts(links.into_iter()).collect::<Vec<_>>(), [7, 1]);
    }
}
