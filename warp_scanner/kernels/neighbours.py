"""Warp device code for clouds: nearest neighbours and voxels. No allocation on the host, no NumPy. Lengths in metres.

All arithmetic is float64 and multiplications are never fused with additions: results equal those of NumPy, and a
rounded distance to a box never exceeds the rounded distance to a point inside it, so that culling is exact.
"""

import warp as wp

wp.set_module_options({"enable_backward": False})

CHUNK = 16  # neighbouring points that are searched for, or among, together: inner loops become vector instructions
GROUP = 16  # chunks that share one more bound
BINS = 4096  # most cells that a part of a cloud is sorted into at a time


@wp.struct
class Clouds:
    """Clouds one after the other, each in an order where neighbours in memory are neighbours in space."""

    point: wp.array[wp.float64]  # (3 N,) x, y, z as they came
    start: wp.array[int]  # (clouds + 1,) first point of each cloud
    group_start: wp.array[int]  # (clouds + 1,) first group of each cloud
    order: wp.array[int]  # (N,) out: point of the cloud in each place
    spare: wp.array[int]  # (N,) scratch
    cell: wp.array[int]  # (N,) scratch
    crowd_end: wp.array[int]  # (N,) scratch
    chunk: wp.array[wp.float64]  # (groups, GROUP, 3, CHUNK) out: coordinates; copies of a point fill a chunk up
    index: wp.array[wp.int64]  # (groups, GROUP, CHUNK) out: point of the cloud
    chunk_bounds: wp.array[wp.float64]  # (groups, 6, GROUP) out: low x, y, z and high x, y, z; nowhere when empty
    group_bounds: wp.array[wp.float64]  # (6, groups) out
    distance: wp.array[wp.float64]  # (N,) out: of each point to the nearest of the cloud that it searches
    nearest: wp.array[int]  # (N,) out: that point of the other cloud


# A crowd of points is sorted into cells of its own bounds, as wide as high; cells that are still crowded are crowds
# again, until none is left or its points coincide. So a far outlier costs one more round, not the resolution of the
# rest, and memory does not depend on extents. Cells follow each other like furrows of a field: a chunk seldom jumps.
@wp.func_native(
    """
    const long long first = clouds.start.data[cloud];
    const int count = clouds.start.data[cloud + 1] - clouds.start.data[cloud];
    const double *__restrict point = clouds.point.data + 3 * first;
    int *__restrict order = clouds.order.data + first, *__restrict spare = clouds.spare.data + first;
    int *__restrict cell = clouds.cell.data + first, *__restrict crowd_end = clouds.crowd_end.data + first;
    int place[BINS + 1];
    for (int i = 0; i < count; ++i) order[i] = i;
    if (count > 0) crowd_end[0] = count;
    for (int begin = 0; begin < count;) {
        const int end = crowd_end[begin];
        if (end - begin <= CHUNK) { begin = end; continue; }
        double low[3], size[3];
        for (int a = 0; a < 3; ++a) {
            double least = point[3LL * order[begin] + a], most = least;
            for (int i = begin + 1; i < end; ++i) {
                const double v = point[3LL * order[i] + a];
                least = v < least ? v : least;
                most = v > most ? v : most;
            }
            low[a] = least; size[a] = most - least;
        }
        double longest = size[0] > size[1] ? size[0] : size[1];
        longest = size[2] > longest ? size[2] : longest;
        if (longest < 1e-30) { begin = end; continue; }
        const int most = end - begin < BINS ? end - begin : BINS;
        double edge = longest / most, cells[3];
        do {
            edge *= 1.25;
            for (int a = 0; a < 3; ++a) cells[a] = __builtin_floor(size[a] / edge) + 1.0;
        } while (cells[0] * cells[1] * cells[2] > most);
        const int ny = (int)(cells[1]), nz = (int)(cells[2]), bins = (int)(cells[0]) * ny * nz;
        const double scale = 1.0 / edge;
        for (int k = 0; k <= bins; ++k) place[k] = 0;
        for (int i = begin; i < end; ++i) {
            const double *v = point + 3LL * order[i];
            const int x = (int)((v[0] - low[0]) * scale);
            int y = (int)((v[1] - low[1]) * scale), z = (int)((v[2] - low[2]) * scale);
            y = y < ny ? y : ny - 1; z = z < nz ? z : nz - 1;
            y = x & 1 ? ny - 1 - y : y;
            const int furrow = x * ny + y;
            const int k = furrow * nz + (furrow & 1 ? nz - 1 - z : z);
            cell[i] = k < bins ? k : bins - 1;
            ++place[cell[i] + 1];
        }
        place[0] = begin;
        for (int k = 0; k < bins; ++k) {
            const int next = place[k] + place[k + 1];
            if (next > place[k]) crowd_end[place[k]] = next;
            place[k + 1] = next;
        }
        for (int i = begin; i < end; ++i) spare[place[cell[i]]++] = order[i];
        for (int i = begin; i < end; ++i) order[i] = spare[i];
    }
""".replace("CHUNK", str(CHUNK)).replace("BINS", str(BINS))
)
def sort_points(clouds: Clouds, cloud: int): ...


@wp.func_native(
    """
    const long long first = clouds.start.data[cloud];
    const int count = clouds.start.data[cloud + 1] - clouds.start.data[cloud];
    const double *__restrict point = clouds.point.data + 3 * first;
    const int *__restrict order = clouds.order.data + first;
    const long long all = clouds.group_start.data[clouds.group_start.shape[0] - 1];
    const double infinity = __builtin_inf();
    for (long long group = clouds.group_start.data[cloud]; group < clouds.group_start.data[cloud + 1]; ++group) {
        const int base = (int)(group - clouds.group_start.data[cloud]) * GROUP * CHUNK;
        double around[6] = {infinity, infinity, infinity, -infinity, -infinity, -infinity};
        double *__restrict bounds = clouds.chunk_bounds.data + group * 6 * GROUP;
        for (int c = 0; c < GROUP; ++c) {
            double box[6] = {infinity, infinity, infinity, -infinity, -infinity, -infinity};
            double *__restrict to = clouds.chunk.data + (group * GROUP + c) * 3 * CHUNK;
            long long *__restrict index = clouds.index.data + (group * GROUP + c) * CHUNK;
            const int from = base + c * CHUNK;
            for (int i = 0; from < count && i < CHUNK; ++i) {
                const int k = order[from + i < count ? from + i : count - 1];
                index[i] = k;
                for (int a = 0; a < 3; ++a) {
                    const double v = point[3LL * k + a];
                    to[a * CHUNK + i] = v;
                    box[a] = v < box[a] ? v : box[a];
                    box[a + 3] = v > box[a + 3] ? v : box[a + 3];
                }
            }
            for (int a = 0; a < 3; ++a) {
                bounds[a * GROUP + c] = box[a];
                bounds[(a + 3) * GROUP + c] = box[a + 3];
                around[a] = box[a] < around[a] ? box[a] : around[a];
                around[a + 3] = box[a + 3] > around[a + 3] ? box[a + 3] : around[a + 3];
            }
        }
        for (int a = 0; a < 6; ++a) clouds.group_bounds.data[a * all + group] = around[a];
    }
""".replace("CHUNK", str(CHUNK)).replace("GROUP", str(GROUP))
)
def cut_chunks(clouds: Clouds, cloud: int): ...


@wp.kernel
def arrange_clouds(first: int, clouds: Clouds):
    cloud = first + wp.tid()
    sort_points(clouds, cloud)
    cut_chunks(clouds, cloud)


# All points of a chunk search together. Groups, then chunks, whose bounds lie beyond the worst of the nearest
# distances so far are skipped; the others are tested, all points against all. Of equally near points the lowest
# index wins, so bounds at exactly the worst distance count as near and the order of testing cannot show. The search
# starts with the chunk where the chunk before found most, which is seldom far off.
@wp.func_native(
    """
#pragma clang fp contract(off)
    const long long all = clouds.group_start.data[clouds.group_start.shape[0] - 1];
    const long long group_begin = clouds.group_start.data[other], group_end = clouds.group_start.data[other + 1];
    const double *__restrict group_low = clouds.group_bounds.data, *__restrict group_high = group_low + 3 * all;
    const double infinity = __builtin_inf();
    const double *__restrict qx = clouds.chunk.data + chunk * 3 * CHUNK, *qy = qx + CHUNK, *qz = qy + CHUNK;
    double low[3], high[3], best[CHUNK];
    long long who[CHUNK];
    for (int a = 0; a < 3; ++a) {
        const double *bounds = clouds.chunk_bounds.data + chunk / GROUP * 6 * GROUP + chunk % GROUP;
        low[a] = bounds[a * GROUP];
        high[a] = bounds[(a + 3) * GROUP];
    }
    for (int i = 0; i < CHUNK; ++i) { best[i] = infinity; who[i] = -1; }
    double worst = infinity;
    auto visit = [&](long long c) {
        const double *__restrict p = clouds.chunk.data + c * 3 * CHUNK;
        const long long *__restrict index = clouds.index.data + c * CHUNK;
        for (int j = 0; j < CHUNK; ++j) {
            const double x = p[j], y = p[CHUNK + j], z = p[2 * CHUNK + j];
            const long long k = index[j];
            for (int i = 0; i < CHUNK; ++i) {
                const double dx = qx[i] - x, dy = qy[i] - y, dz = qz[i] - z;
                const double d = dx * dx + dy * dy + dz * dz;
                const bool better = (d < best[i]) | ((d == best[i]) & (k < who[i]));
                best[i] = better ? d : best[i];
                who[i] = better ? k : who[i];
            }
        }
        long long bits[CHUNK], most = 0;
        __builtin_memcpy(bits, best, sizeof(bits));
        for (int i = 0; i < CHUNK; ++i) most = bits[i] > most ? bits[i] : most;
        __builtin_memcpy(&worst, &most, 8);
    };
    // Squared distance of two boxes, of a box and a point, from strided coordinates of their corners.
    auto apart = [](const double *low, const double *high, long long s,
                    const double *lows, const double *highs, long long t) {
        double sum = 0.0;
        for (int a = 0; a < 3; ++a) {
            const double below = low[a * s] - highs[a * t], above = lows[a * t] - high[a * s];
            double gap = below > above ? below : above;
            gap = gap > 0.0 ? gap : 0.0;
            sum += gap * gap;
        }
        return sum;
    };
    visit(guess);
    long long last = guess;
    for (long long base = group_begin; base < group_end; base += 64) {
        double far[64];
        const int some = group_end - base < 64 ? (int)(group_end - base) : 64;
        for (int g = 0; g < some; ++g) far[g] = apart(low, high, 1, group_low + base + g, group_high + base + g, all);
        for (int g = 0; g < some; ++g) {
            if (far[g] > worst) continue;
            const double *lows = clouds.chunk_bounds.data + (base + g) * 6 * GROUP, *highs = lows + 3 * GROUP;
            double near[GROUP];
            for (int c = 0; c < GROUP; ++c) near[c] = apart(low, high, 1, lows + c, highs + c, GROUP);
            int turn[GROUP], found = 0;
            for (int c = 0; c < GROUP; ++c) {
                if (near[c] > worst || near[c] == infinity) continue;
                int k = found++;
                for (; k > 0 && near[turn[k - 1]] > near[c]; --k) turn[k] = turn[k - 1];
                turn[k] = c;
            }
            for (int t = 0; t < found; ++t) {
                const int c = turn[t];
                const long long candidate = (base + g) * GROUP + c;
                if (near[c] > worst || candidate == guess) continue;
                double box[6];
                for (int a = 0; a < 6; ++a) box[a] = lows[a * GROUP + c];
                int any = 0;
                for (int i = 0; i < CHUNK; ++i)
                    any |= apart(qx + i, qx + i, CHUNK, box, box + 3, 1) <= best[i];
                if (!any) continue;
                const double before = worst;
                visit(candidate);
                if (worst < before) last = candidate;
            }
        }
    }
    const long long first = clouds.start.data[cloud];
    for (int i = 0; i < CHUNK; ++i) {
        const long long to = first + clouds.index.data[chunk * CHUNK + i];
        clouds.distance.data[to] = __builtin_sqrt(best[i]);
        clouds.nearest.data[to] = (int)(who[i]);
    }
    return last;
""".replace("CHUNK", str(CHUNK)).replace("GROUP", str(GROUP))
)
def search_chunk(clouds: Clouds, cloud: int, chunk: wp.int64, other: int, guess: wp.int64) -> wp.int64: ...


@wp.kernel
def search_clouds(
    first: int,
    clouds: Clouds,
    task: wp.array2d[int],  # (tasks, 4) cloud that searches, cloud that is searched, first chunk, chunk after the last
):
    number = first + wp.tid()
    cloud = task[number, 0]
    other = task[number, 1]
    guess = wp.int64(clouds.group_start[other] * GROUP)
    for chunk in range(task[number, 2], task[number, 3]):
        guess = search_chunk(clouds, cloud, wp.int64(chunk), other, guess)
