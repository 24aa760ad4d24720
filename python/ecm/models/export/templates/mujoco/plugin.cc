// Passive force of the mechanism @NAME@ for MuJoCo: a plugin named ecm.@NAME@.
//
// The mechanism stands between two sites: `base`, its clamped end (empty: the world), and `top`, its
// platform. The wrench of the model is what holds the platform; the plugin applies its opposite to
// the body of `top` and the wrench itself to that of `base`, at the origin of `top`.
//
// tendons = N: the fixed tendons @NAME@_mode_0 .. N-1 already carry the linear part, which the plugin
// then leaves to them: tendons and plugin together are the whole model, whatever the joints are.
// Actuators of the mechanism are MuJoCo's, named @NAME@_ and the column of the input: its value is their
// activation where they have one (dyntype), else their control, within its range.
// Effects of time: the state is MuJoCo's plugin_state, so that reset, copies and saved states hold it.
// temperature_degC and age_s are inputs of these effects (empty: nothing changes).
#include <cmath>
#include <cstdlib>
#include <cstring>

#include <mujoco/mjplugin.h>
#include <mujoco/mujoco.h>

#include "@NAME@.h"

#define HAS_STATE @STEPS@

namespace {

constexpr int kMostTendons = 6;
constexpr int kInputs = @INPUTCOUNT@;
const char* const kInputNames[] = {@INPUTNAMES@nullptr};

struct Instance {
  int top = -1, base = -1;
  int tendon_count = 0;
  int tendons[kMostTendons];
  int actuators[kInputs + 1];
  // Pose and time of the last compute: advance is called when they are gone.
  double pose[6] = {}, time = 0;
#if HAS_STATE
  @NAME@_conditions inputs = @NAME@_default_conditions;
#endif
};

#if HAS_STATE
// What MuJoCo keeps: whether the state has begun, its time, and the state.
struct Kept {
  double begun, time;
  @NAME@_state state;
};
constexpr int kKept = sizeof(Kept) / sizeof(mjtNum);
static_assert(sizeof(Kept) % sizeof(mjtNum) == 0, "mjtNum must be double");
#else
constexpr int kKept = 0;
#endif

// Ends the program, or raises in Python, with the reason.
int Fail(const char* reason, const char* detail = "") {
  mju_error("ecm.@NAME@: %s%s", reason, detail);
  return -1;
}

int Site(const mjModel* m, int instance, const char* key) {
  const char* name = mj_getPluginConfig(m, instance, key);
  return name && *name ? mj_name2id(m, mjOBJ_SITE, name) : -2;
}

// 1 where a number is stated, 0 where it is not, -1 where it cannot be read.
int Number(const mjModel* m, int instance, const char* key, double* value) {
  const char* text = mj_getPluginConfig(m, instance, key);
  if (!text || !*text) return 0;
  char* end;
  *value = std::strtod(text, &end);
  return *end == 0 && std::isfinite(*value) ? 1 : -1;
}

int Init(const mjModel* m, mjData* d, int instance) {
  Instance found;
  found.top = Site(m, instance, "top");
  found.base = Site(m, instance, "base");
  if (found.top < 0) return Fail("config top: expected the name of the platform's site");
  if (found.base == -1) return Fail("config base: no site of this name; leave it out for the world");
  double count = 0;
  const int said = Number(m, instance, "tendons", &count);
  if (said < 0 || count < 0 || count > kMostTendons || count != std::floor(count)) {
    return Fail("config tendons: expected 0 to 6");
  }
  found.tendon_count = static_cast<int>(count);
  for (int k = 0; k < found.tendon_count; k++) {
    char name[] = "@NAME@_mode_0";
    name[sizeof name - 2] = static_cast<char>('0' + k);
    found.tendons[k] = mj_name2id(m, mjOBJ_TENDON, name);
    if (found.tendons[k] < 0) return Fail("config tendons: no tendon ", name);
  }
  for (int k = 0; k < kInputs; k++) {
    found.actuators[k] = mj_name2id(m, mjOBJ_ACTUATOR, kInputNames[k]);
    if (found.actuators[k] < 0) return Fail("no actuator ", kInputNames[k]);
  }
#if HAS_STATE
  if (Number(m, instance, "temperature_degC", &found.inputs.temperature_degC) < 0 ||
      Number(m, instance, "age_s", &found.inputs.age_s) < 0) {
    return Fail("config temperature_degC, age_s: expected numbers");
  }
  if (m->opt.integrator == mjINT_RK4) {
    return Fail("effects of time need one evaluation a step: take Euler or implicitfast, not RK4");
  }
#endif
  d->plugin_data[instance] = reinterpret_cast<uintptr_t>(new Instance(found));
  return 0;
}

Instance* Of(const mjData* d, int instance) {
  return reinterpret_cast<Instance*>(d->plugin_data[instance]);
}

// Position and rotation vector of `top` in the frame of `base`.
void FindPose(const mjData* d, const Instance& at, mjtNum pose[6]) {
  const mjtNum* top = d->site_xpos + 3 * at.top;
  mjtNum away[3], rotation[9], quaternion[4];
  if (at.base >= 0) {
    const mjtNum* base = d->site_xmat + 9 * at.base;
    mju_sub3(away, top, d->site_xpos + 3 * at.base);
    mju_mulMatTVec3(pose, base, away);
    mju_mulMatTMat(rotation, base, d->site_xmat + 9 * at.top, 3, 3, 3);
  } else {
    mju_copy3(pose, top);
    mju_copy(rotation, d->site_xmat + 9 * at.top, 9);
  }
  mju_mat2Quat(quaternion, rotation);
  mju_quat2Vel(pose + 3, quaternion, 1);
}

#if !HAS_STATE
mjtNum Input(const mjModel* m, const mjData* d, int actuator) {
  if (m->actuator_actadr[actuator] >= 0) return d->act[m->actuator_actadr[actuator]];
  if (!m->actuator_ctrllimited[actuator]) return d->ctrl[actuator];
  const mjtNum* range = m->actuator_ctrlrange + 2 * actuator;
  return mju_clip(d->ctrl[actuator], range[0], range[1]);
}
#endif

// The wrench that holds the platform at `pose`; plain zero where the model means nothing.
void FindWrench(const mjModel* m, const mjData* d, int address, const Instance& at,
                const mjtNum pose[6], mjtNum h[6]) {
#if HAS_STATE
  (void)m;
  double k[36];
  Kept kept;
  std::memcpy(&kept, d->plugin_state + address, sizeof kept);
  if (kept.begun == 0) {
    @NAME@_init(&kept.state, pose);
    kept.time = d->time;
  }
  @NAME@_step(&kept.state, pose, d->time - kept.time, &at.inputs, h, k);
#else
  (void)address;
  mjtNum row[6 + kInputs];
  mju_copy(row, pose, 6);
  for (int k = 0; k < kInputs; k++) row[6 + k] = Input(m, d, at.actuators[k]);
  @NAME@_value(row, h);
#endif
}

void Compute(const mjModel* m, mjData* d, int instance, int capability) {
  (void)capability;
  Instance* at = Of(d, instance);
  mjtNum h[6], force[3], torque[3];
  FindPose(d, *at, at->pose);
  at->time = d->time;
  FindWrench(m, d, m->plugin_stateadr[instance], *at, at->pose, h);
  if (!std::isfinite(h[0] + h[1] + h[2] + h[3] + h[4] + h[5])) {
    mj_warning(d, mjWARN_BADQPOS, 0);  // half a turn, or no number: no force
    return;
  }
  const mjtNum* point = d->site_xpos + 3 * at->top;
  if (at->base >= 0) {
    mju_mulMatVec3(force, d->site_xmat + 9 * at->base, h);
    mju_mulMatVec3(torque, d->site_xmat + 9 * at->base, h + 3);
    mj_applyFT(m, d, force, torque, point, m->site_bodyid[at->base], d->qfrc_passive);
  } else {
    mju_copy3(force, h);
    mju_copy3(torque, h + 3);
  }
  mju_scl3(force, force, -1);
  mju_scl3(torque, torque, -1);
  mj_applyFT(m, d, force, torque, point, m->site_bodyid[at->top], d->qfrc_passive);
  if (m->opt.disableflags & mjDSBL_SPRING) return;  // the tendons carry nothing
  for (int k = 0; k < at->tendon_count; k++) {
    const int tendon = at->tendons[k];
    const mjtNum along =
        m->tendon_stiffness[tendon] * (d->ten_length[tendon] - m->tendon_lengthspring[2 * tendon]);
    for (int w = 0; w < m->tendon_num[tendon]; w++) {
      const int wrap = m->tendon_adr[tendon] + w;
      d->qfrc_passive[m->jnt_dofadr[m->wrap_objid[wrap]]] += along * m->wrap_prm[wrap];
    }
  }
}

#if HAS_STATE
void Advance(const mjModel* m, mjData* d, int instance) {
  const Instance* at = Of(d, instance);
  mjtNum* place = d->plugin_state + m->plugin_stateadr[instance];
  double h[6], k[36];
  Kept kept;
  std::memcpy(&kept, place, sizeof kept);
  if (kept.begun == 0) {
    kept.begun = @NAME@_init(&kept.state, at->pose);
  } else if (!@NAME@_step(&kept.state, at->pose, at->time - kept.time, &at->inputs, h, k)) {
    return;  // refused: the state and its time stay
  }
  kept.time = at->time;
  std::memcpy(place, &kept, sizeof kept);
}
#endif

}  // namespace

mjPLUGIN_LIB_INIT(ecm_@NAME@) {
  static const char* attributes[] = {"top", "base", "tendons", "temperature_degC", "age_s"};
  mjpPlugin plugin;
  mjp_defaultPlugin(&plugin);
  plugin.name = "ecm.@NAME@";
  plugin.nattribute = sizeof attributes / sizeof attributes[0];
  plugin.attributes = attributes;
  plugin.capabilityflags |= mjPLUGIN_PASSIVE;
  plugin.nstate = +[](const mjModel*, int) { return kKept; };
  plugin.init = Init;
  plugin.destroy = +[](mjData* d, int instance) {
    delete Of(d, instance);
    d->plugin_data[instance] = 0;
  };
  plugin.copy = +[](mjData* to, const mjModel*, const mjData* from, int instance) {
    if (to->plugin_data[instance] != from->plugin_data[instance] && Of(to, instance)) {
      *Of(to, instance) = *Of(from, instance);
    } else {
      to->plugin_data[instance] = reinterpret_cast<uintptr_t>(new Instance(*Of(from, instance)));
    }
  };
  plugin.reset = +[](const mjModel*, mjtNum* state, void*, int) {
    for (int i = 0; i < kKept; i++) state[i] = 0;
  };
  plugin.compute = Compute;
#if HAS_STATE
  plugin.advance = Advance;
#endif
  mjp_registerPlugin(&plugin);
}
