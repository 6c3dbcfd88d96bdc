"""Cooperation of the threads of a block; one block computes one world.

On a CPU a block has a single thread, and none of these functions does anything.
"""

import warp as wp


@wp.func_native("""
#if defined(__CUDA_ARCH__)
__syncthreads();
#endif
""")
def barrier():
    """Wait for all threads of the block, which then see what the others wrote."""
    ...


@wp.func_native("""
#if defined(__CUDA_ARCH__)
asm volatile("bar.sync 1, %0;" ::"r"(n_threads) : "memory");
#endif
""")
def barrier_of(n_threads: int):
    """Wait for the first `n_threads` of the block, a multiple of 32, as `barrier` does for all."""
    ...


NO_SUM = wp.constant(wp.int64(-9223372036854775807))
"""Result of `sum_if_any` if no flag is set."""


@wp.func_native("""
#if defined(__CUDA_ARCH__)
__shared__ long long part[32];
long long sum = value;
for (int step = 16; step > 0; step >>= 1) sum += __shfl_xor_sync(0xFFFFFFFFu, sum, step);
if ((threadIdx.x & 31) == 0) part[threadIdx.x >> 5] = sum;
unsigned any;
asm volatile("{ .reg .pred p, q; setp.ne.u32 p, %1, 0; bar.red.or.pred q, 1, %2, p; selp.u32 %0, 1, 0, q; }"
             : "=r"(any) : "r"((unsigned)flag), "r"(n_threads) : "memory");
if (any == 0) return -9223372036854775807LL;
sum = 0;
for (int warp = 0; warp < n_threads >> 5; ++warp) sum += part[warp];
return sum;
#else
return flag ? value : -9223372036854775807LL;
#endif
""")
def sum_if_any(flag: bool, value: wp.int64, n_threads: int) -> wp.int64:
    """Return the sum over the first `n_threads` if any of them sets its flag, else `NO_SUM`.

    The sum is of whole numbers, so that the order of the threads does not matter. It is a barrier
    for these threads, too; another one has to come before the next sum.
    """
    ...


@wp.func
def threads_for(n: int) -> int:
    """Return the number of threads of the block that share n tasks, a multiple of 32 on a GPU."""
    return wp.min((n + 31) // 32 * 32, wp.block_dim())
