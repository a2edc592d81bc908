// Deferral: what kernels that decide nearly everything leave to a second pass, whose kernels decide the rest (table in
// geometry.cl).
//
// Every kernel has an array `deferred` as an argument: how many items are undecided, then which.
//   postpone            puts a triangle aside until the traversal is done; false in kernels that decide everything at
//                       once
//   DECIDE_BY_INTEGERS  what `call`, in exact integers, decides; or false, and the item is deferred
//   NOTE_DEFERRED       puts an item on the list if it is deferred
//   FORGET_DEFERRED     whether an item is deferred, and forgets it: for work-items with several items
//   ADD_DEFERRED        what these put an item on the list by
//   ITEM_OF             the item of work-item number i: in the second pass that on the list
//   RAY_OF              the same of the rays of a batch, which have an order: ORDER_ARGUMENT, see batch.cl
#define DEFERRED_ARGUMENT volatile __global uint* restrict deferred,
#ifdef DEFER_UNDECIDED
#define UNDECIDED_STATE            \
    uint postponed[MAX_POSTPONED]; \
    Undecided undecided = {0u, 0u, postponed};
#define DECIDE_BY_INTEGERS(geometry, call) ((geometry)->undecided->is_deferred = 1u, false)
#define IS_DEFERRED (undecided.is_deferred != 0u)
#define ADD_DEFERRED(item) deferred[1u + atomic_inc(&deferred[0])] = item
#define FORGET_DEFERRED(geometry) forget_deferred(geometry)
#define NOTE_DEFERRED(item)    \
    if (IS_DEFERRED) ADD_DEFERRED(item)
bool forget_deferred(const Geometry* geometry) {
    const bool is_deferred = geometry->undecided->is_deferred != 0u;
    geometry->undecided->is_deferred = 0u;
    return is_deferred;
}
bool postpone(const Geometry* geometry, uint primitive) {
    Undecided* undecided = geometry->undecided;
    for (uint i = 0; i < undecided->count; i++)
        if (undecided->primitives[i] == primitive) return true; // met again in another leaf
    if (undecided->count == MAX_POSTPONED)
        undecided->is_deferred = 1u;
    else
        undecided->primitives[undecided->count++] = primitive;
    return true;
}
#else
#define UNDECIDED_STATE
#define DECIDE_BY_INTEGERS(geometry, call) call
#define IS_DEFERRED false
#define ADD_DEFERRED(item)
#define FORGET_DEFERRED(geometry) false
#define NOTE_DEFERRED(item)
bool postpone(const Geometry* geometry, uint primitive) { return false; }
#endif
#ifdef RESOLVE_DEFERRED
#define ITEM_OF(i) deferred[1u + (i)]
#define RAY_OF(i) ITEM_OF(i)
#else
#define ITEM_OF(i) (i)
#define RAY_OF(i) ray_at(i, row, in_bands, sorted)
#endif

// For rare calls (geometry.cl): what a ray has left undecided, handed on and taken back.
#ifdef DEFER_UNDECIDED
#define UNDECIDED_ARGUMENT , uint is_deferred, uint count, uint* postponed
#define UNDECIDED_VALUE , undecided.is_deferred, undecided.count, undecided.primitives
#define TAKE_UNDECIDED Undecided undecided = {is_deferred, count, postponed};
#define TAKE_DEFERRED(call) undecided.is_deferred = (call) ? 1u : 0u
#else
#define UNDECIDED_ARGUMENT
#define UNDECIDED_VALUE
#define TAKE_UNDECIDED
#define TAKE_DEFERRED(call) (void)(call)
#endif
