//! Links of packed hierarchies of boxes to their leaves, the same for two and for eight children a node, and to
//! instances; the bits are in `bvh2.rs`.

use crate::options::BvhOptions;
use crate::shared::{BVH_COUNT_SHIFT, BVH_FIRST_MASK, BVH_LEAF};
use std::ops::Range;

/// The link to a child that is none: a leaf without triangles.
pub(super) const NO_CHILD: u32 = leaf_link(0, 0);

/// The link to a leaf of `count` triangles, references `first` and following.
pub(crate) const fn leaf_link(first: u32, count: u32) -> u32 {
    debug_assert!(count <= BvhOptions::MAX_LEAF && first <= BVH_FIRST_MASK);
    BVH_LEAF | count << BVH_COUNT_SHIFT | first
}

/// The link to instance number `number`: a leaf without triangles, but not [`NO_CHILD`].
pub(crate) const fn instance_link(number: u32) -> u32 {
    debug_assert!(number < BVH_FIRST_MASK);
    BVH_LEAF | (number + 1)
}

/// The instance that `link` leads to; `None` for the link of a node or of a leaf, [`NO_CHILD`] among them, which rays
/// from very far away meet.
pub(crate) fn instance_of(link: u32) -> Option<u32> {
    let is_empty_leaf = link & BVH_LEAF != 0 && link & !BVH_LEAF & !BVH_FIRST_MASK == 0;
    (link & BVH_FIRST_MASK).checked_sub(1).filter(|_| is_empty_leaf)
}

/// The references of the leaf that `link` leads to, none of them for [`NO_CHILD`]; `None` for the number of an inner
/// node.
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
    use crate::shared::{BVH_END, BVH_LEAVE};

    #[test]
    fn links_to_leaves_come_apart_again() {
        for (first, count) in [(0, 1), (8, 15), (BVH_FIRST_MASK, 1), (BVH_FIRST_MASK - 15, 15)] {
            let link = leaf_link(first, count);
            assert_eq!(leaf_range(link), Some(first as usize..(first + count) as usize));
            assert!(link != BVH_END && link != NO_CHILD);
        }
        assert_eq!(leaf_range(NO_CHILD), Some(0..0));
        for number in [0, 1, BVH_FIRST_MASK - 1] {
            let link = instance_link(number);
            assert_eq!((instance_of(link), leaf_range(link).map(|leaf| leaf.len())), (Some(number), Some(0)));
            assert!(![BVH_END, BVH_LEAVE, NO_CHILD].contains(&link));
        }
        assert_eq!([0, NO_CHILD, leaf_link(0, 1), BVH_END, BVH_LEAVE].map(instance_of), [None; 5]);
        assert_eq!([0, 1, BVH_LEAF - 1].map(leaf_range), [None, None, None]);
        let links = [3, leaf_link(0, 7), NO_CHILD, leaf_link(7, 1)];
        assert_eq!(leaf_counts(links.into_iter()).collect::<Vec<_>>(), [7, 1]);
    }
}
