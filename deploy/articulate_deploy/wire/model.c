/* Model library that clients of protocol 5 download and load: forward kinematics and Jacobians of
   the Panda, a constant diagonal mass matrix, no Coriolis and no gravity torque (the simulated
   robot compensates gravity itself). All matrices are column-major. */

#include <math.h>
#include <string.h>

#ifndef M_PI_2
#define M_PI_2 1.57079632679489661923
#endif

/* Modified Denavit-Hartenberg parameters a, d, alpha of joints 1 to 7; row 8 is the flange. */
static const double DH[8][3] = {
    {0.0, 0.333, 0.0},       {0.0, 0.0, -M_PI_2},    {0.0, 0.316, M_PI_2},  {0.0825, 0.0, M_PI_2},
    {-0.0825, 0.384, -M_PI_2}, {0.0, 0.0, M_PI_2},   {0.088, 0.0, M_PI_2},  {0.0, 0.107, 0.0}};
static const double INERTIA[7] = {2.0, 2.0, 1.2, 1.2, 0.3, 0.35, 0.15};

static void multiply(const double *a, const double *b, double *out) {
  for (int c = 0; c < 4; ++c)
    for (int r = 0; r < 4; ++r) {
      double sum = 0.0;
      for (int k = 0; k < 4; ++k) sum += a[4 * k + r] * b[4 * c + k];
      out[4 * c + r] = sum;
    }
}

/* Poses of the frames 1 to 9: joints, flange, end effector. */
static void frames(const double *q, const double *F_T_EE, double T[9][16]) {
  double last[16] = {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1};
  for (int i = 0; i < 8; ++i) {
    const double a = DH[i][0], d = DH[i][1], ca = cos(DH[i][2]), sa = sin(DH[i][2]);
    const double c = i < 7 ? cos(q[i]) : 1.0, s = i < 7 ? sin(q[i]) : 0.0;
    const double step[16] = {c,   s * ca,  s * sa, 0, -s, c * ca, c * sa, 0,
                             0.0, -sa,     ca,     0, a,  -sa * d, ca * d, 1};
    multiply(last, step, T[i]);
    memcpy(last, T[i], sizeof last);
  }
  if (F_T_EE)
    multiply(T[7], F_T_EE, T[8]);
  else
    memcpy(T[8], T[7], sizeof last);
}

/* Jacobian of frame n (1 to 9) in the axes of the base, or of the frame itself. */
static void jacobian(int n, const double *q, const double *F_T_EE, int body, double *J) {
  double T[9][16];
  frames(q, F_T_EE, T);
  memset(J, 0, 42 * sizeof(double));
  const double *E = T[n - 1];
  for (int i = 0; i < 7 && i < n; ++i) {
    const double *z = T[i] + 8, *p = T[i] + 12;
    const double r[3] = {E[12] - p[0], E[13] - p[1], E[14] - p[2]};
    const double v[6] = {z[1] * r[2] - z[2] * r[1], z[2] * r[0] - z[0] * r[2],
                         z[0] * r[1] - z[1] * r[0], z[0], z[1], z[2]};
    for (int half = 0; half < 2; ++half)
      for (int k = 0; k < 3; ++k) {
        double value = v[3 * half + k];
        if (body) {
          value = 0.0;
          for (int j = 0; j < 3; ++j) value += E[4 * k + j] * v[3 * half + j];
        }
        J[6 * i + 3 * half + k] = value;
      }
  }
}

static void pose(int n, const double *q, const double *F_T_EE, double *out) {
  double T[9][16];
  frames(q, F_T_EE, T);
  memcpy(out, T[n - 1], 16 * sizeof(double));
}

#define POSE(n) \
  void O_T_J##n(const double q[7], double out[16]) { pose(n, q, 0, out); }
#define JACOBIANS(n)                                                                    \
  void O_J_J##n(const double q[7], double out[42]) { jacobian(n, q, 0, 0, out); }       \
  void Ji_J_J##n(const double q[7], double out[42]) { jacobian(n, q, 0, 1, out); }

POSE(1) POSE(2) POSE(3) POSE(4) POSE(5) POSE(6) POSE(7) POSE(8)
JACOBIANS(2) JACOBIANS(3) JACOBIANS(4) JACOBIANS(5) JACOBIANS(6) JACOBIANS(7) JACOBIANS(8)

void O_J_J1(double out[42]) {
  const double q[7] = {0};
  jacobian(1, q, 0, 0, out);
}
void Ji_J_J1(double out[42]) {
  const double q[7] = {0};
  jacobian(1, q, 0, 1, out);
}
void O_T_J9(const double q[7], const double F_T_EE[16], double out[16]) {
  pose(9, q, F_T_EE, out);
}
void O_J_J9(const double q[7], const double F_T_EE[16], double out[42]) {
  jacobian(9, q, F_T_EE, 0, out);
}
void Ji_J_J9(const double q[7], const double F_T_EE[16], double out[42]) {
  jacobian(9, q, F_T_EE, 1, out);
}
void M_NE(const double q[7], const double I[9], double m, const double c[3], double out[49]) {
  (void)q, (void)I, (void)m, (void)c;
  memset(out, 0, 49 * sizeof(double));
  for (int i = 0; i < 7; ++i) out[8 * i] = INERTIA[i];
}
void c_NE(const double q[7], const double dq[7], const double I[9], double m, const double c[3],
          double out[7]) {
  (void)q, (void)dq, (void)I, (void)m, (void)c;
  memset(out, 0, 7 * sizeof(double));
}
void g_NE(const double q[7], const double g[3], double m, const double c[3], double out[7]) {
  (void)q, (void)g, (void)m, (void)c;
  memset(out, 0, 7 * sizeof(double));
}
