// Counting of work: what each counter counts, WorkCounter in src/shared.rs says. A sum that outgrows 32 bits stays at
// the largest number. Without COUNT_WORK nothing of it is in the code.
//   WORK_SUMS        declares the sums of a Geometry; those of MAKE_GEOMETRY are called `work`
//   COUNT            adds n to a counter
//   COUNT_DEEPEST    raises the deepest stack to so many entries
//   COUNTED          a value that was read, counted as so many bytes
//   WORK_ARGUMENT    the kernels' array of WORK_COUNTERS numbers a ray or pixel, before the last two arguments
//   STORE_WORK       writes what was counted in a Geometry as record `index` of that array
#ifdef COUNT_WORK
void count_work(uint* work, uint counter, uint n) { work[counter] = add_sat(work[counter], n); }
void store_work(__global uint* records, uint index, const Geometry* geometry) {
    for (uint i = 0; i < WORK_COUNTERS; i++) records[(size_t)index * WORK_COUNTERS + i] = geometry->work[i];
}
#define WORK_SUMS(name) uint name[WORK_COUNTERS] = {0};
#define COUNT(geometry, counter, n) count_work((geometry)->work, WORK_##counter, n)
#define COUNT_DEEPEST(geometry, n) (geometry)->work[WORK_DEEPEST_STACK] = max((geometry)->work[WORK_DEEPEST_STACK], n)
#define COUNTED(geometry, counter, bytes, value) (COUNT(geometry, counter, bytes), value)
#define WORK_ARGUMENT __global uint* restrict work_records,
#define STORE_WORK(geometry, index) store_work(work_records, index, geometry)
#else
#define WORK_SUMS(name)
#define COUNT(geometry, counter, n)
#define COUNT_DEEPEST(geometry, n)
#define COUNTED(geometry, counter, bytes, value) value
#define WORK_ARGUMENT
#define STORE_WORK(geometry, index)
#endif
