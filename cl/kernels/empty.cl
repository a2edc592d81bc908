// A program of one kernel that does nothing: what a compiler says of it, it says of the options.
__kernel void empty(void) {}
