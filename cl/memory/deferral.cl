// Deferral: what kernels that decide nearly everything leave to a second pass, whose kernels decide the rest (table in
// geometry.cl).
//
// Every kernel has an array `doubts` as an argument: how many items are in doubt, then which.
//   postpone            puts a triangle aside until the traversal is done; false in kernels that decide everything at
//                       once
//   DECIDE_BY_INTEGERS  what `call`, in exact integers, decides; or false, and the item is in doubt
//   NOTE_DOUBT          puts an item on the list if it is in doubt
//   TAKE_IN_DOUBT       whether an item is in doubt, and forgets it: for work-items with several items
//   ADD_DOUBT           what these put an item on the list by
//   ITEM_OF             the item of work-item number i: in the second pass that on the list
//   RAY_OF              the same of the rays of a batch, which may have rows: ROWS_ARGUMENT, see batch.cl
#define DOUBTS_ARGUMENT volatile __global uint* restrict doubts,
#ifdef DEFER_DOUBTS
#define UNDECIDED                  \
    uint postponed[MAX_POSTPONED]; \
    Undecided undecided = {0u, 0u, postponed};
#define DECIDE_BY_INTEGERS(geometry, call) ((geometry)->undecided->in_doubt = 1u, false)
#define IN_DOUBT (undecided.in_doubt != 0u)
#define ADD_DOUBT(item) doubts[1u + atomic_inc(&doubts[0])] = item
#define TAKE_IN_DOUBT(geometry) take_in_doubt(geometry)
#define NOTE_DOUBT(item)    \
    if (IN_DOUBT) ADD_DOUBT(item)
bool take_in_doubt(const Geometry* geometry) {
    const bool in_doubt = geometry->undecided->in_doubt != 0u;
    geometry->undecided->in_doubt = 0u;
    return in_doubt;
}
bool postpone(const Geometry* geometry, uint primitive) {
    Undecided* undecided = geometry->undecided;
    for (uint i = 0; i < undecided->count; i++)
        if (undecided->primitives[i] == primitive) return true; // met again in another leaf
    if (undecided->count == MAX_POSTPONED)
        undecided->in_doubt = 1u;
    else
        undecided->primitives[undecided->count++] = primitive;
    return true;
}
#else
#define UNDECIDED
#define DECIDE_BY_INTEGERS(geometry, call) call
#define IN_DOUBT false
#define ADD_DOUBT(item)
#define TAKE_IN_DOUBT(geometry) false
#define NOTE_DOUBT(item)
bool postpone(const Geometry* geometry, uint primitive) { return false; }
#endif
#ifdef RESOLVE_DOUBTS
#define ITEM_OF(i) doubts[1u + (i)]
#define RAY_OF(i) ITEM_OF(i)
#else
#define ITEM_OF(i) (i)
#define RAY_OF(i) ray_at(i, row, in_bands)
#endif

// For rare calls (geometry.cl): what a ray has left undecided, handed on and taken back.
#ifdef DEFER_DOUBTS
#define UNDECIDED_ARGUMENT , uint in_doubt, uint count, uint* postponed
#define UNDECIDED_VALUE , undecided.in_doubt, undecided.count, undecided.primitives
#define TAKE_UNDECIDED Undecided undecided = {in_doubt, count, postponed};
#define TAKE_DOUBT(call) undecided.in_doubt = (call) ? 1u : 0u
#else
#define UNDECIDED_ARGUMENT
#define UNDECIDED_VALUE
#define TAKE_UNDECIDED
#define TAKE_DOUBT(call) (void)(call)
#endif
