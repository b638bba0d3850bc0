/* The law of benchmarks/twolink.py in C: same formulas, same order. */
#include <math.h>

#define DT 0.001
#define COUNTS 10000.0
#define A0 1.2
#define B0 0.35
#define C0 0.4
#define G1 12.0
#define G12 4.0
#define L1 0.5
#define L2 0.4
#define GRAVITY 9.81
#define STIFFNESS 400.0
#define ROTOR 0.2
#define COULOMB 0.6
#define STICTION 0.9
#define VISCOUS 0.3
#define STRIBECK 0.1
#define TAU_MAX 60.0
#define ADAPTATION 0.05
#define LAMBDA 5.0
#define SMOOTH 50.0
#define LOW_PASS 0.25

static const double AMPLITUDE[2] = {0.8, 0.6}, OMEGA[2] = {1.0, 1.5};
static const double GAINS[4] = {160000.0, 32000.0, 2400.0, 80.0};

typedef struct { double x, y; } pair;

static void trajectory(double t, double a, double w, double d[5])
{
    double s = sin(w * t), c = cos(w * t), e = exp(-0.3 * t * t * t);
    double p = 0.9 * t * t, p1 = 1.8 * t, p2 = 1.8;
    double e0 = 1.0 - e, e1 = p * e, e2 = (p1 - p * p) * e;
    double e3 = (p2 - 3.0 * p * p1 + p * p * p) * e;
    double e4 = (-3.0 * p1 * p1 - 4.0 * p * p2 + 6.0 * p * p * p1 - p * p * p * p) * e;
    double s1 = w * c, s2 = -w * w * s, s3 = -w * w * w * c, s4 = w * w * w * w * s;
    d[0] = a * s * e0;
    d[1] = a * (s1 * e0 + s * e1);
    d[2] = a * (s2 * e0 + 2.0 * s1 * e1 + s * e2);
    d[3] = a * (s3 * e0 + 3.0 * s2 * e1 + 3.0 * s1 * e2 + s * e3);
    d[4] = a * (s4 * e0 + 4.0 * s3 * e1 + 6.0 * s2 * e2 + 4.0 * s1 * e3 + s * e4);
}

static double velocity(double *state, int k, double reading)
{
    state[4 + k] += LOW_PASS * ((reading - state[k]) / DT - state[4 + k]);
    state[k] = reading;
    return state[4 + k];
}

static pair bias(double q1, double q2, double v1, double v2, double b, double g1, double g12)
{
    double s2 = sin(q2), gravity = g12 * cos(q1 + q2);
    return (pair){-b * s2 * (2.0 * v1 * v2 + v2 * v2) + g1 * cos(q1) + gravity, b * s2 * v1 * v1 + gravity};
}

static pair bias_rate(double q1, double q2, double v1, double v2, pair a, double b, double g1, double g12)
{
    double s2 = sin(q2), c2 = cos(q2);
    double p = 2.0 * v1 * v2 + v2 * v2, p1 = 2.0 * (a.x * v2 + v1 * a.y + v2 * a.y);
    double gravity = -g12 * sin(q1 + q2) * (v1 + v2);
    double first = -b * (c2 * v2 * p + s2 * p1) - g1 * sin(q1) * v1 + gravity;
    return (pair){first, b * (c2 * v2 * v1 * v1 + 2.0 * s2 * v1 * a.x) + gravity};
}

static pair bias_curvature(
    double q1, double q2, double v1, double v2, pair a, pair j, double b, double g1, double g12)
{
    double s2 = sin(q2), c2 = cos(q2), w = v1 + v2;
    double p = 2.0 * v1 * v2 + v2 * v2, p1 = 2.0 * (a.x * v2 + v1 * a.y + v2 * a.y);
    double p2 = 2.0 * (j.x * v2 + 2.0 * a.x * a.y + v1 * j.y + a.y * a.y + v2 * j.y);
    double turn = c2 * a.y - s2 * v2 * v2;
    double gravity = -g12 * (cos(q1 + q2) * w * w + sin(q1 + q2) * (a.x + a.y));
    double first = -b * (turn * p + 2.0 * c2 * v2 * p1 + s2 * p2);
    first += gravity - g1 * (cos(q1) * v1 * v1 + sin(q1) * a.x);
    return (pair){first, b * (turn * v1 * v1 + 4.0 * c2 * v2 * v1 * a.x + 2.0 * s2 * (a.x * a.x + v1 * j.x)) + gravity};
}

static double friction(double v)
{
    double rise = COULOMB + (STICTION - COULOMB) * exp(-(v / STRIBECK) * (v / STRIBECK));
    return rise * tanh(SMOOTH * v) + VISCOUS * v;
}

static double iteration(double *state, double t)
{
    double d1[5], d2[5];
    trajectory(t, AMPLITUDE[0], OMEGA[0], d1);
    trajectory(t, AMPLITUDE[1], OMEGA[1], d2);
    double q1 = floor(d1[0] * COUNTS) / COUNTS, q2 = floor(d2[0] * COUNTS) / COUNTS;
    double th1 = q1 + 0.01, th2 = q2 + 0.005;
    double v1 = velocity(state, 0, q1), v2 = velocity(state, 1, q2);
    double w1 = velocity(state, 2, th1), w2 = velocity(state, 3, th2);
    double load = state[8];
    double a = A0 + load * (L1 * L1 + L2 * L2), b = B0 + load * L1 * L2, c = C0 + load * L2 * L2;
    double g1 = G1 + load * L1 * GRAVITY, g12 = G12 + load * L2 * GRAVITY;
    double c2 = cos(q2), s2 = sin(q2);
    double m11 = a + 2.0 * b * c2, m12 = c + b * c2, m22 = c;
    double det = m11 * m22 - m12 * m12;
    pair h = bias(q1, q2, v1, v2, b, g1, g12);
    double f1 = STIFFNESS * (th1 - q1) - h.x, f2 = STIFFNESS * (th2 - q2) - h.y;
    pair acc = {(m22 * f1 - m12 * f2) / det, (m11 * f2 - m12 * f1) / det};
    double r11 = -2.0 * b * s2 * v2, r12 = -b * s2 * v2;
    pair k = bias_rate(q1, q2, v1, v2, acc, b, g1, g12);
    f1 = STIFFNESS * (w1 - v1) - r11 * acc.x - r12 * acc.y - k.x;
    f2 = STIFFNESS * (w2 - v2) - r12 * acc.x - k.y;
    pair jerk = {(m22 * f1 - m12 * f2) / det, (m11 * f2 - m12 * f1) / det};
    double y1 = d1[4] + GAINS[3] * (d1[3] - jerk.x) + GAINS[2] * (d1[2] - acc.x);
    double y2 = d2[4] + GAINS[3] * (d2[3] - jerk.y) + GAINS[2] * (d2[2] - acc.y);
    y1 += GAINS[1] * (d1[1] - v1) + GAINS[0] * (d1[0] - q1);
    y2 += GAINS[1] * (d2[1] - v2) + GAINS[0] * (d2[0] - q2);
    pair n = bias_curvature(q1, q2, v1, v2, acc, jerk, b, g1, g12);
    double u11 = -2.0 * b * (c2 * v2 * v2 + s2 * acc.y);
    double x1 = m11 * y1 + m12 * y2 + 2.0 * (r11 * jerk.x + r12 * jerk.y) + u11 * acc.x + 0.5 * u11 * acc.y + n.x;
    double x2 = m12 * y1 + m22 * y2 + 2.0 * r12 * jerk.x + 0.5 * u11 * acc.x + n.y;
    double tau1 = ROTOR * (acc.x + x1 / STIFFNESS) + STIFFNESS * (th1 - q1) + friction(w1);
    double tau2 = ROTOR * (acc.y + x2 / STIFFNESS) + STIFFNESS * (th2 - q2) + friction(w2);
    double off1 = v1 - d1[1] + LAMBDA * (q1 - d1[0]), off2 = v2 - d2[1] + LAMBDA * (q2 - d2[0]);
    double effect1 = (L1 * L1 + L2 * L2) * d1[2] + L1 * GRAVITY * cos(q1) + L2 * GRAVITY * cos(q1 + q2);
    double effect2 = L2 * L2 * d2[2] + L2 * GRAVITY * cos(q1 + q2);
    state[8] = fmin(fmax(load - DT * ADAPTATION * (off1 * effect1 + off2 * effect2), 0.0), 5.0);
    return TAU_MAX * (tanh(tau1 / TAU_MAX) + tanh(tau2 / TAU_MAX));
}

double iterations(double *state, long n)
{
    double total = 0.0;
    for (long k = 0; k < n; k++)
        total += iteration(state, fmod(k * DT, 20.0));
    return total;
}
