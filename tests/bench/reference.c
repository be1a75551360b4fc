/* The yardstick: a bootstrap particle filter (Gordon, Salmond, Smith 1993) as a good C programmer would write it.

   Jiang's bounded velocity (eqs. 1-4) and acoustic energy (eqs. 5-8), S sensors with known gains, the counter noise of
   kernels/noise.py, the weighted mean of each step, systematic resampling where fewer than threshold * n particles are
   effective.

   gcc -O3 -march=native -ffast-math; logarithms, exponentials, sines and cosines are libmvec's. Structure of arrays,
   sensor-outer and particle-inner loops, one division for two readings, one logarithm a particle. Sine and cosine stand
   in loops of their own: in one loop gcc makes a scalar sincos of them.

   -DWIDE  vectors of eight doubles where the processor has them: by itself gcc keeps to four on many that do
   -DOWN   the kernels' own log, power and Box-Muller instead of libmvec's: the same mathematics in both languages */

#ifdef WIDE
#pragma GCC target("prefer-vector-width=512")
#endif

#include <math.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#define GOLDEN 0x9E3779B97F4A7C15ULL

static inline uint64_t mix(uint64_t x)
{
    x = (x ^ (x >> 30)) * 0xBF58476D1CE4E5B9ULL;
    x = (x ^ (x >> 27)) * 0x94D049BB133111EBULL;
    return x ^ (x >> 31);
}

static inline double uniform(uint64_t key, uint64_t draw)
{
    return (double)(mix(key + (draw + 1) * GOLDEN) >> 11) * 0x1p-53;
}

#ifdef OWN

static inline double as_double(uint64_t bits)
{
    double x;
    memcpy(&x, &bits, 8);
    return x;
}

static inline uint64_t as_bits(double x)
{
    uint64_t bits;
    memcpy(&bits, &x, 8);
    return bits;
}

static inline double log2_of(double x)
{
    const uint64_t shifted = as_bits(x) + (0x3FF0000000000000ULL - 0x3FE6A09E667F3BCDULL);
    const double e = (double)(int32_t)(shifted >> 52) - 1023.0;
    const double m = as_double((shifted & 0x000FFFFFFFFFFFFFULL) + 0x3FE6A09E667F3BCDULL);
    const double s = (m - 1.0) / (m + 1.0), z = s * s, zz = z * z;
    const double low = (2.885390081777927 + 0.9617966939243345 * z)
                       + (0.5770780172463286 + 0.4121984020482752 * z) * zz;
    const double high = (0.32061638813224547 + 0.2614442493522915 * z) + 0.2429160853987535 * zz;
    return e + s * (low + high * (zz * zz));
}

static inline double exp2_of(double y)
{
    y = y > -1000.0 ? y : -1000.0;
    const double k = floor(y + 0.5), r = y - k, rr = r * r;
    const double low = (1.0 + 0.69314718055995 * r) + (0.24022650695910097 + 0.05550410866444772 * r) * rr;
    const double middle = (0.009618129107606888 + 0.0013333558230164974 * r)
                          + (0.0001540353044173605 + 1.5252657260200837e-05 * r) * rr;
    const double high = (1.321544258792169e-06 + 1.0208690299958306e-07 * r) + 7.072585949269223e-09 * rr;
    const double p = low + (middle + high * (rr * rr)) * (rr * rr);
    return as_double(as_bits(p) + ((uint64_t)(int64_t)(int32_t)k << 52));
}

static inline double log_of(double x) { return 0.6931471805599453 * log2_of(x); }
static inline double exp_of(double y) { return exp2_of(1.4426950408889634 * y); }

/* A pair whose bases do not matter where a power is made of it. */
#define LOG log2_of
#define EXP exp2_of

/* sqrt(-2 log(1 - u)) times cosine and sine of a turn: quarters, and Taylor series on [-pi/4, pi/4]. */
static inline void box_muller(double u, double turn, double *first, double *second)
{
    const double radius = sqrt(-2.0 * log_of(1.0 - u)), quarter = floor(4.0 * turn + 0.5);
    const double a = (turn - 0.25 * quarter) * 6.283185307179586, z = a * a;
    double sine = 1.0 / 6227020800.0, cosine = -1.0 / 87178291200.0;
    sine = sine * z - 1.0 / 39916800.0;
    sine = sine * z + 1.0 / 362880.0;
    sine = sine * z - 1.0 / 5040.0;
    sine = sine * z + 1.0 / 120.0;
    sine = sine * z - 1.0 / 6.0;
    sine = a + a * z * sine;
    cosine = cosine * z + 1.0 / 479001600.0;
    cosine = cosine * z - 1.0 / 3628800.0;
    cosine = cosine * z + 1.0 / 40320.0;
    cosine = cosine * z - 1.0 / 720.0;
    cosine = cosine * z + 1.0 / 24.0;
    cosine = cosine * z - 0.5;
    cosine = cosine * z + 1.0;
    const int odd = (quarter == 1.0) | (quarter == 3.0);
    const double c = odd ? sine : cosine, s = odd ? cosine : sine;
    *first = radius * ((quarter == 1.0) | (quarter == 2.0) ? -c : c);
    *second = radius * ((quarter == 2.0) | (quarter == 3.0) ? -s : s);
}

static void make_normal(int n, double *restrict first, double *restrict second, double *restrict spare)
{
    (void)spare;
    for (int j = 0; j < n; j++) {
        double one, two;
        box_muller(first[j], second[j], &one, &two);
        first[j] = one;
        second[j] = two;
    }
}

#else

#define log_of log
#define exp_of exp

#define LOG log
#define EXP exp

static void make_normal(int n, double *restrict first, double *restrict second, double *restrict spare)
{
    for (int j = 0; j < n; j++) {
        spare[j] = sqrt(-2.0 * log(1.0 - first[j]));
        second[j] *= 6.283185307179586;
    }
    for (int j = 0; j < n; j++)
        first[j] = spare[j] * cos(second[j]);
    for (int j = 0; j < n; j++)
        second[j] = spare[j] * sin(second[j]);
}

#endif

/* Draws 4j + from and 4j + from + 1 of the step's key. */
static void draw_uniforms(int n, uint64_t key, int from, double *restrict first, double *restrict second)
{
    for (int j = 0; j < n; j++) {
        first[j] = uniform(key, 4 * (uint64_t)j + from);
        second[j] = uniform(key, 4 * (uint64_t)j + from + 1);
    }
}

static void move(int n, double *restrict p, double *restrict v, const double *restrict first,
                 const double *restrict second, const double *drift, const double *root)
{
    const double step = drift[0], bound = drift[1], c1 = drift[2], c2 = drift[3];
    const double l11 = root[0], l21 = root[1], l22 = root[2];
    for (int j = 0; j < n; j++) {
        double pull = c1 * p[j] + c2 * v[j];
        pull = fabs(p[j]) <= bound ? 0.0 : pull;
        const double position = p[j] + step * v[j], velocity = v[j] - step * pull;
        p[j] = position + l11 * first[j];
        v[j] = velocity + l21 * first[j] + l22 * second[j];
    }
}

/* mu = noise + loudness d^-decay, d floored at 1 m. Two short loops overlap better than a long one. */
static void means_at(int n, const double *restrict x, const double *restrict y, const double *sensor, double loudness,
                     double noise, double decay, double *restrict mean)
{
    const double x_sensor = sensor[0], y_sensor = sensor[1], slope = -0.5 * decay;
    for (int j = 0; j < n; j++) {
        const double dx = x[j] - x_sensor, dy = y[j] - y_sensor, squared = dx * dx + dy * dy;
        mean[j] = slope * LOG(squared > 1.0 ? squared : 1.0);
    }
    for (int j = 0; j < n; j++)
        mean[j] = noise + loudness * EXP(mean[j]);
}

/* log_weights -= the sum over sensors of (z/mu - 1)^2 / (2 spread) + log mu, up to a constant. In place of a sensor
   that is missing in the last pass stand a mean and a reading of one. rows: room for four times n. */
static void weigh(int n, int sensors, const double *x, const double *y, const double *readings,
                  const double *positions, const double *gains, const double *law, double *restrict log_weights,
                  double *const *rows)
{
    const double noise = law[0], intensity = law[1], decay = law[2], spread = law[3];
    double *restrict square = rows[0], *restrict product = rows[1], *restrict mean = rows[2], *restrict other = rows[3];
    for (int j = 0; j < n; j++) {
        square[j] = 0.0;
        product[j] = 1.0;
    }
    for (int s = 0; s < sensors; s += 2) {
        const double z = readings[s], z_other = s + 1 < sensors ? readings[s + 1] : 1.0;
        means_at(n, x, y, positions + 2 * s, gains[s] * intensity, noise, decay, mean);
        if (s + 1 < sensors)
            means_at(n, x, y, positions + 2 * s + 2, gains[s + 1] * intensity, noise, decay, other);
        else
            for (int j = 0; j < n; j++)
                other[j] = 1.0;
        for (int j = 0; j < n; j++) {
            const double both = mean[j] * other[j], inverse = 1.0 / both;
            const double off = z * other[j] * inverse - 1.0, off_other = z_other * mean[j] * inverse - 1.0;
            square[j] += off * off + off_other * off_other;
            product[j] *= both;
        }
    }
    for (int j = 0; j < n; j++)
        log_weights[j] -= 0.5 / spread * square[j] + log_of(product[j]);
}

/* Weights relative to the largest; their sum and sum of squares. */
static void relative(int n, const double *restrict log_weights, double *restrict weights, double *sums)
{
    double top = log_weights[0], total = 0.0, squares = 0.0;
    for (int j = 1; j < n; j++)
        top = log_weights[j] > top ? log_weights[j] : top;
    for (int j = 0; j < n; j++) {
        const double below = log_weights[j] - top, w = exp_of(below > -345.0 ? below : -345.0);
        weights[j] = w;
        total += w;
        squares += w * w;
    }
    sums[0] = total;
    sums[1] = squares;
}

static void moments(int n, double *const *cloud, const double *restrict weights, double total, double *mean)
{
    const double *restrict a = cloud[0], *restrict b = cloud[1], *restrict c = cloud[2], *restrict d = cloud[3];
    double sa = 0.0, sb = 0.0, sc = 0.0, sd = 0.0;
    for (int j = 0; j < n; j++) {
        sa += weights[j] * a[j];
        sb += weights[j] * b[j];
        sc += weights[j] * c[j];
        sd += weights[j] * d[j];
    }
    mean[0] = sa / total;
    mean[1] = sb / total;
    mean[2] = sc / total;
    mean[3] = sd / total;
}

/* Systematic resampling without branches: where each column's teeth begin, then a running maximum. */
static void choose(int n, const double *restrict weights, double total, double start, double *restrict reached,
                   int32_t *restrict begins, int32_t *restrict chosen)
{
    const double scale = n / total;
    double before = 0.0;
    for (int j = 0; j < n; j++) {
        reached[j] = before;
        before += weights[j];
    }
    for (int j = 0; j < n; j++) {
        const int32_t place = (int32_t)ceil(reached[j] * scale - start);
        begins[j] = place < n ? place : n;
    }
    memset(chosen, 0, (size_t)n * sizeof *chosen);
    for (int j = 0; j < n; j++)
        chosen[begins[j]] = j;
    int32_t last = 0;
    for (int i = 0; i < n; i++) {
        last = chosen[i] > last ? chosen[i] : last;
        chosen[i] = last;
    }
}

static void take(int n, const int32_t *restrict chosen, double *const *cloud, double *const *spare)
{
    for (int d = 0; d < 4; d++) {
        const double *restrict from = cloud[d];
        double *restrict to = spare[d];
        for (int j = 0; j < n; j++)
            to[j] = from[chosen[j]];
    }
}

/* means (steps, 4) of a filter that starts from `start` (4, n), equally weighted.
   Gives how often it resampled, -1 where there is no room. */
int run(int n, int steps, int sensors, const double *start, const double *readings, const double *positions,
        const double *gains, const double *law, const double *drift, const double *root, double threshold,
        const uint64_t *keys, double *means)
{
    const size_t room = ((size_t)n + 16) / 8 * 8;
    double *memory = aligned_alloc(64, 13 * room * sizeof(double));
    int32_t *integers = aligned_alloc(64, 4 * room * sizeof(int32_t));
    if (!memory || !integers) {
        free(memory);
        free(integers);
        return -1;
    }
    double *row[13], *cloud[4], *spare[4];
    for (int i = 0; i < 13; i++)
        row[i] = memory + i * room;
    for (int d = 0; d < 4; d++) {
        cloud[d] = row[d];
        spare[d] = row[4 + d];
        for (int j = 0; j < n; j++)
            cloud[d][j] = start[(size_t)d * n + j];
    }
    double *log_weights = row[8], *weights = row[9], *r1 = row[10], *r2 = row[11], *r3 = row[12];
    int resampled = 0;
    for (int j = 0; j < n; j++)
        log_weights[j] = 0.0;
    for (int k = 0; k < steps; k++) {
        const uint64_t now = keys[k];
        double sums[2];
        for (int axis = 0; axis < 2; axis++) {
            draw_uniforms(n, now, 2 * axis, r1, r2);
            make_normal(n, r1, r2, r3);
            move(n, cloud[2 * axis], cloud[2 * axis + 1], r1, r2, drift, root);
        }
        double *const rows[4] = {r1, r2, r3, weights};
        weigh(n, sensors, cloud[0], cloud[2], readings + (size_t)k * sensors, positions, gains, law, log_weights, rows);
        relative(n, log_weights, weights, sums);
        moments(n, cloud, weights, sums[0], means + 4 * (size_t)k);
        if (sums[0] * sums[0] < threshold * n * sums[1]) {
            choose(n, weights, sums[0], uniform(now, 4 * (uint64_t)n), r1, integers, integers + 2 * room);
            take(n, integers + 2 * room, cloud, spare);
            for (int d = 0; d < 4; d++) {
                double *swap = cloud[d];
                cloud[d] = spare[d];
                spare[d] = swap;
            }
            for (int j = 0; j < n; j++)
                log_weights[j] = 0.0;
            resampled++;
        }
    }
    free(memory);
    free(integers);
    return resampled;
}
