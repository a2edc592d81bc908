// Random bits that are the same everywhere: hashes of whole numbers, by integer operations alone.
//
// Products with odd constants (those of xxHash, Collet 2012), then the finaliser of MurmurHash3 (Appleby 2011), in
// which half of the result's bits change with every bit of the input. Jarzynski and Olano, "Hash Functions for GPU
// Rendering", JCGT 9(3), 2020, compare hashes of both families with others.
//
// No secrets: who knows the constants can look for inputs of equal hash.

// A permutation of all words.
uint mix_bits(uint h) {
    h = (h ^ (h >> 16)) * HASH_FIRST;
    h = (h ^ (h >> 13)) * HASH_SECOND;
    return h ^ (h >> 16);
}

// The hash of some words and one more. Of equal `hash` two words never have the same one.
uint hash_word(uint hash, uint word) { return mix_bits(hash ^ (word * HASH_X)); }
