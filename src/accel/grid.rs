//! Uniform grid. Amanatides and Woo, "A Fast Voxel Traversal Algorithm for Ray Tracing", Eurographics 1987; thesis,
//! section 2.2.3.
//!
//! A triangle is listed in every cell that its box touches, the box being widened by the walk's rounding errors: the
//! proof that this is enough stands in `cl/traverse/grid.cl`. Boxes instead of the triangles themselves cost references
//! (a diagonal triangle over n³ cells is in all of them, not in some n²) and save the time and the rounding errors of a
//! triangle-cell test.
//!
//! Bad at: triangles of very different sizes. Memory is bounded by limits on cells and references.

use super::near::few_outside;
use super::{Aabb, StructureArrays};
use crate::error::{Error, Result};
use crate::layout::Float4;
use crate::options::GridOptions;
use crate::shared::KdNode;
use glam::Vec3;

/// Cells for each triangle, unless told otherwise: "several", as everywhere since Cleary et al. (1983); the 35³ cells
/// that Havran took in 1999 for the 4,096 triangles of the SPD's tetra are 10.5.
const CELLS_PER_TRIANGLE: f64 = 8.0;

/// The default grid is made coarser as long as there are more references for each triangle than this.
const MAX_GROWTH: usize = 64;

/// Rays from up to this many scene extents away walk; the price is the margin, 3/16384 of the extent.
const REACH: f32 = 64.0;

/// Margin of the boxes in units of EPSILON D (see `cl/traverse/grid.cl`, where 38 are needed).
const MARGIN: f64 = 48.0;

/// The most references of a grid: 512 MiB.
const MAX_REFERENCES: usize = 1 << 27;

/// A grid's planes.
struct Grid {
    low: Vec3,
    high: Vec3,
    cell: Vec3,
    size: [u32; 3],
    /// The planes between cells, of each axis.
    planes: [Vec<f32>; 3],
    margin: f64,
    reach: f32,
}

impl Grid {
    fn new(bounds: Aabb, size: [u32; 3]) -> Grid {
        let extent = bounds.high - bounds.low;
        // Slices of an axis without extent would all lie in one plane.
        let size: [u32; 3] = std::array::from_fn(|k| if extent[k] > 0.0 { size[k] } else { 1 });
        let cell = Vec3::from_array(std::array::from_fn(|k| extent[k] / size[k] as f32));
        let reach = REACH * extent.max_element();
        Grid {
            low: bounds.low,
            high: bounds.high,
            cell,
            size,
            planes: std::array::from_fn(|k| {
                (1..size[k]).map(|plane| (plane as f32).mul_add(cell[k], bounds.low[k])).collect()
            }),
            margin: MARGIN * f64::from(crate::bounds::EPSILON) * f64::from(reach),
            reach,
        }
    }

    /// First and last cell of each axis that a triangle's widened box touches.
    fn cells_of(&self, triangle: &[Vec3; 3]) -> [[usize; 2]; 3] {
        let bounds = Aabb::of_triangle(triangle);
        std::array::from_fn(|k| {
            let (low, high) = (f64::from(bounds.low[k]) - self.margin, f64::from(bounds.high[k]) + self.margin);
            [
                self.planes[k].partition_point(|&plane| f64::from(plane) < low),
                self.planes[k].partition_point(|&plane| f64::from(plane) <= high),
            ]
        })
    }

    fn cell_count(&self) -> usize {
        self.size.iter().map(|&n| n as usize).product()
    }

    fn reference_count(&self, vertices: &[[Vec3; 3]], primitives: &[u32]) -> usize {
        let count = |&primitive: &u32| -> usize {
            self.cells_of(&vertices[primitive as usize]).iter().map(|[first, last]| last - first + 1).product()
        };
        primitives.iter().map(count).fold(0, usize::saturating_add)
    }

    /// Calls `visit` with the number of every cell that lists the triangle.
    fn visit_cells(&self, triangle: &[Vec3; 3], mut visit: impl FnMut(usize)) {
        let [x, y, z] = self.cells_of(triangle);
        let [count_x, count_y, _] = self.size.map(|n| n as usize);
        for z in z[0]..=z[1] {
            for y in y[0]..=y[1] {
                let row = (z * count_y + y) * count_x;
                (row + x[0]..=row + x[1]).for_each(&mut visit);
            }
        }
    }

    fn fill(&self, vertices: &[[Vec3; 3]], primitives: &[u32], outside: &[u32]) -> StructureArrays {
        let mut ends = vec![0usize; self.cell_count() + 1];
        for &primitive in primitives {
            self.visit_cells(&vertices[primitive as usize], |cell| ends[cell + 1] += 1);
        }
        for cell in 1..ends.len() {
            ends[cell] += ends[cell - 1];
        }
        let nodes = ends.windows(2).map(|range| StructureArrays::leaf(range[0], range[1])).collect();
        let mut references = vec![0; *ends.last().expect("a grid has a cell")];
        // From here on ends[cell] is where the cell's next triangle goes.
        for &primitive in primitives {
            self.visit_cells(&vertices[primitive as usize], |cell| {
                references[ends[cell]] = primitive;
                ends[cell] += 1;
            });
        }
        let all = references.len() as u32;
        references.extend(outside.iter().chain(primitives));
        let inverse = |x: f32| if (1.0 / x).is_finite() { 1.0 / x } else { 0.0 };
        let per_unit = Vec3::from_array(self.cell.to_array().map(inverse));
        let count = self.size.map(f32::from_bits);
        let bounds = vec![
            Float4::new(self.low, count[0]),
            Float4::new(self.cell, count[1]),
            Float4::new(per_unit, count[2]),
            Float4::new(Vec3::new(self.reach, f32::from_bits(all), f32::from_bits(outside.len() as u32)), 0.0),
            Float4::new(self.high, 0.0),
        ];
        StructureArrays { nodes, references, bounds }
    }
}

/// About [`CELLS_PER_TRIANGLE`] nearly cubic cells for each triangle: the cube-root rule, over the axes that are not
/// too thin to be divided.
fn default_size(extent: Vec3, triangle_count: usize, cells_per_triangle: f64) -> [u32; 3] {
    let cells = (cells_per_triangle * triangle_count as f64).clamp(1.0, GridOptions::MAX_CELLS as f64);
    let mut divided: Vec<usize> = (0..3).filter(|&k| extent[k] > 0.0).collect();
    let mut per_unit = 0.0;
    while !divided.is_empty() {
        let volume: f64 = divided.iter().map(|&k| f64::from(extent[k])).product();
        per_unit = (cells / volume).powf(1.0 / divided.len() as f64);
        let before = divided.len();
        divided.retain(|&k| f64::from(extent[k]) * per_unit >= 1.0);
        if divided.len() == before {
            break;
        }
    }
    // Rounded down, so that there are not more cells than wanted.
    std::array::from_fn(|k| if divided.contains(&k) { (f64::from(extent[k]) * per_unit).max(1.0) as u32 } else { 1 })
}

/// What a cell takes while it is filled: a counter, and its record.
const CELL_BYTES: u64 = (size_of::<usize>() + size_of::<KdNode>()) as u64;

/// What a grid of the default size takes for each triangle, which some cells list.
pub(super) const DEFAULT_BYTES: f64 = CELLS_PER_TRIANGLE * CELL_BYTES as f64;

/// Builds a grid over the triangles `primitives` (ascending indices into `vertices`) in `bounds`, the box around them
/// all, with `size` cells along the axes, or by the cube-root rule of 8 cells for each triangle. Where few reach beyond
/// `near_reach`, which is that of [`near_reach`](super::near_reach), the grid is of the others, and these are tested
/// for every ray.
///
/// # Errors
/// [`Error::Option`] when there are more references than memory should be spent on.
pub fn build_grid(
    vertices: &[[Vec3; 3]],
    primitives: &[u32],
    bounds: Aabb,
    size: Option<[u32; 3]>,
    near_reach: f32,
) -> Result<StructureArrays> {
    build_grid_within(vertices, primitives, bounds, size, near_reach, &|_| Ok(()))
}

/// As [`build_grid`], when `check` has nothing against the bytes that the grid takes.
pub(crate) fn build_grid_within(
    vertices: &[[Vec3; 3]],
    primitives: &[u32],
    bounds: Aabb,
    size: Option<[u32; 3]>,
    near_reach: f32,
    check: &dyn Fn(u64) -> Result<()>,
) -> Result<StructureArrays> {
    if let Some((outside, inside, bounds)) = few_outside(vertices, primitives, near_reach) {
        return build_inside(vertices, &inside, bounds, size, &outside, check);
    }
    build_inside(vertices, primitives, bounds, size, &[], check)
}

/// The same, with a list of the triangles that are `outside` of it.
fn build_inside(
    vertices: &[[Vec3; 3]],
    primitives: &[u32],
    bounds: Aabb,
    size: Option<[u32; 3]>,
    outside: &[u32],
    check: &dyn Fn(u64) -> Result<()>,
) -> Result<StructureArrays> {
    let fill = |grid: Grid, references: usize| {
        check(CELL_BYTES * grid.cell_count() as u64 + size_of::<u32>() as u64 * references as u64)?;
        Ok(grid.fill(vertices, primitives, outside))
    };
    if let Some(size) = size {
        let grid = Grid::new(bounds, size);
        let references = grid.reference_count(vertices, primitives);
        if references > MAX_REFERENCES {
            let message = format!("{references} references are over the limit of {MAX_REFERENCES}; take fewer cells");
            return Err(Error::option("grid_size", message));
        }
        return fill(grid, references);
    }
    let mut cells_per_triangle = CELLS_PER_TRIANGLE;
    loop {
        let size = default_size(bounds.high - bounds.low, primitives.len(), cells_per_triangle);
        let grid = Grid::new(bounds, size);
        let references = grid.reference_count(vertices, primitives);
        // One cell lists each triangle once.
        if references <= MAX_GROWTH * primitives.len() || grid.cell_count() == 1 {
            return fill(grid, references);
        }
        cells_per_triangle /= 2.0;
    }
}
