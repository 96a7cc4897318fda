"""Warp device code that thins clouds to one point per voxel. No allocation on the host, no NumPy. Lengths in metres.

All arithmetic is float64 and multiplications are never fused with additions, so that cells and choices are those
of the same formulas in NumPy.
"""

import warp as wp

wp.set_module_options({"enable_backward": False})

LANES = 16  # points whose cells are found together: loops over them become vector instructions
EQUALLY_NEAR = 1e-6  # [voxels] difference of two distances that counts as none


@wp.struct
class Clouds:
    """Clouds one after the other, and what thinning them has to remember."""

    point: wp.array[wp.float64]  # (3 N,) x, y, z; turned into scratch: the point seen from the centre of its cell
    start: wp.array[int]  # (clouds + 1,) first point of each cloud
    table_start: wp.array[int]  # (clouds + 1,) first entry of each cloud's table; its length is a power of two
    table: wp.array[int]  # scratch: voxel by the hash of its cell, -1 where none is
    voxel: wp.array[int]  # (N,) scratch: voxel of each point
    key: wp.array[wp.int64]  # (N,) scratch: cell of each voxel as one number
    total: wp.array[wp.float64]  # (4 N,) scratch: sum of the local points of each voxel, then its mean; their number
    apart: wp.array[wp.float64]  # (N,) scratch: distance of each point to the mean of its voxel
    least: wp.array[wp.float64]  # (N,) scratch: the least of them in each voxel
    kept: wp.array[int]  # (N,) out: the chosen points of each cloud, ascending, packed to its front
    kept_count: wp.array[int]  # (clouds,) out: how many; -1 where the cells are too many to be numbered


# Cells are found by their hash, so memory depends on the number of points and never on their extent. Neighbours of a
# scan often share a cell: the table is asked only when it changes.
@wp.func_native(
    """
#pragma clang fp contract(off)
    const long long first = clouds.start.data[cloud];
    const int count = clouds.start.data[cloud + 1] - clouds.start.data[cloud];
    double *__restrict point = clouds.point.data + 3 * first, *__restrict total = clouds.total.data + 4 * first;
    int *__restrict voxel = clouds.voxel.data + first;
    long long *__restrict key = clouds.key.data + first;
    int *__restrict table = clouds.table.data + clouds.table_start.data[cloud];
    const int entries = clouds.table_start.data[cloud + 1] - clouds.table_start.data[cloud];
    if (count == 0) return 0;
    double least[3 * LANES], most[3 * LANES], low[3], cells[3];
    for (int k = 0; k < 3 * LANES; ++k) least[k] = most[k] = point[k % 3];
    for (long long i = 0; i < 3LL * (count / LANES * LANES); i += 3 * LANES)
        for (int k = 0; k < 3 * LANES; ++k) {
            least[k] = point[i + k] < least[k] ? point[i + k] : least[k];
            most[k] = point[i + k] > most[k] ? point[i + k] : most[k];
        }
    for (long long i = 3LL * (count / LANES * LANES); i < 3LL * count; ++i) {
        least[i % 3] = point[i] < least[i % 3] ? point[i] : least[i % 3];
        most[i % 3] = point[i] > most[i % 3] ? point[i] : most[i % 3];
    }
    for (int a = 0; a < 3; ++a) {
        for (int k = a; k < 3 * LANES; k += 3) {
            least[a] = least[k] < least[a] ? least[k] : least[a];
            most[a] = most[k] > most[a] ? most[k] : most[a];
        }
        // A cell never falls as its coordinate rises, so the outermost points have the outermost cells.
        low[a] = __builtin_floor(least[a] / size + 0.5);
        cells[a] = __builtin_floor(most[a] / size + 0.5) - low[a] + 1.0;
    }
    if (!(cells[0] * cells[1] * cells[2] < 4611686018427387904.0)) return -1;  // 2^62: numbers of cells fit 64 bits
    const long long ny = (long long)(cells[1]), nz = (long long)(cells[2]);
    int shift = 64;
    for (int n = entries; n > 1; n /= 2) --shift;
    for (int k = 0; k < entries; ++k) table[k] = -1;
    int found = 0, v = 0;
    long long last = -1;
    for (int base = 0; base < count; base += LANES) {
        const int some = count - base < LANES ? count - base : LANES;
        double *__restrict p = point + 3LL * base;
        double cell[3 * LANES], within[3 * LANES];
        for (int k = 0; k < 3 * some; ++k) {
            cell[k] = __builtin_floor(p[k] / size + 0.5);
            within[k] = p[k] - cell[k] * size;
        }
        for (int i = 0; i < some; ++i) {
            const long long x = (long long)(cell[3 * i] - low[0]), y = (long long)(cell[3 * i + 1] - low[1]);
            const long long number = (x * ny + y) * nz + (long long)(cell[3 * i + 2] - low[2]);
            if (number != last) {
                int k = (int)(((unsigned long long)(number) * 0x9E3779B97F4A7C15ULL) >> shift);
                while (table[k] >= 0 && key[table[k]] != number) k = (k + 1) & (entries - 1);
                if (table[k] < 0) {
                    table[k] = found;
                    key[found] = number;
                    for (int a = 0; a < 4; ++a) total[4LL * found + a] = 0.0;
                    ++found;
                }
                v = table[k];
                last = number;
            }
            voxel[base + i] = v;
            for (int a = 0; a < 3; ++a) {
                p[3 * i + a] = within[3 * i + a];
                total[4LL * v + a] += within[3 * i + a];
            }
            total[4LL * v + 3] += 1.0;
        }
    }
    return found;
""".replace("LANES", str(LANES))
)
def sort_into_voxels(clouds: Clouds, cloud: int, size: wp.float64) -> int: ...


@wp.func_native(
    """
#pragma clang fp contract(off)
    const long long first = clouds.start.data[cloud];
    const int count = clouds.start.data[cloud + 1] - clouds.start.data[cloud];
    const double *__restrict local = clouds.point.data + 3 * first;
    const int *__restrict voxel = clouds.voxel.data + first;
    double *__restrict total = clouds.total.data + 4 * first;
    double *__restrict apart = clouds.apart.data + first, *__restrict least = clouds.least.data + first;
    int *__restrict kept = clouds.kept.data + first;
    for (int v = 0; v < found; ++v) {
        for (int a = 0; a < 3; ++a) total[4LL * v + a] /= total[4LL * v + 3];
        least[v] = __builtin_inf();
    }
    for (int i = 0; i < count; ++i) {
        const double *mean = total + 4LL * voxel[i];
        const double x = local[3LL * i] - mean[0], y = local[3LL * i + 1] - mean[1], z = local[3LL * i + 2] - mean[2];
        apart[i] = __builtin_sqrt(x * x + y * y + z * z);
    }
    for (int i = 0; i < count; ++i) least[voxel[i]] = apart[i] < least[voxel[i]] ? apart[i] : least[voxel[i]];
    int filled = 0;
    for (int i = 0; i < count; ++i) {
        const int v = voxel[i];
        if (apart[i] <= least[v] + EQUALLY_NEAR * size) {
            least[v] = -__builtin_inf();  // the first one has it; no other point is as near as this
            kept[filled++] = i;
        }
    }
    return filled;
""".replace("EQUALLY_NEAR", repr(EQUALLY_NEAR))
)
def choose_points(clouds: Clouds, cloud: int, size: wp.float64, found: int) -> int: ...


@wp.kernel
def thin_clouds(first: int, size: wp.float64, clouds: Clouds):
    cloud = first + wp.tid()
    found = sort_into_voxels(clouds, cloud, size)
    if found >= 0:
        found = choose_points(clouds, cloud, size, found)
    clouds.kept_count[cloud] = found
