// Model files: strict reading, round trip, atomic writing.
#include "ground/model/model_file.h"

#include <fcntl.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <cerrno>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <limits>

#include "ground/model/effect_registry.h"
#include "ground/model/simulation.h"

namespace {
bool link_fails = false;  // as on a file system without hard links
}

/// The C library's, in place of which the library under test takes this one.
extern "C" int link(const char* from, const char* to) noexcept {
  if (!link_fails) return linkat(AT_FDCWD, from, AT_FDCWD, to, 0);
  errno = EPERM;
  return -1;
}

namespace ground {
namespace {

// clang-format off
constexpr char kGood[] = R"yaml(schema: ground/model/1
name: test
body: {m: 0.06, l: 0.03, I_z: 1.0e-4, X_u: 0.01, Y_v: 0.02, N_r: 3.0e-5, k: 0.06, input_max: 1}
effects:
  - name: motor_lag
    tau: 0.05
  - name: battery_sag
    tau: .inf
  - name: washboard
    expression: {X: "a*sin(2*pi*x/w)*cos(psi)", Y: "-a*sin(2*pi*x/w)*sin(psi)"}
    parameters:
      a: {value: 0.01, unit: N, lower: -1, upper: 1, scale: 0.02}
      w: {value: 0.3, unit: m, neutral: 0.3, lower: 0.1, upper: 1}
)yaml";
// clang-format on

std::string replaced(const std::string& from, const std::string& to) {
  std::string text = kGood;
  const std::size_t at = text.find(from);
  EXPECT_NE(at, std::string::npos) << from;
  return text.replace(at, from.size(), to);
}

std::string complaint(const std::string& yaml) {
  try {
    parseModel(yaml, "craft.yaml");
  } catch (const std::runtime_error& error) {
    return error.what();
  }
  return "";
}

TEST(ModelFile, ReadsTheCraftsThatCome) {
  const Model tiny = loadModel("cfg/hovercraft/tiny_whoover.yaml");
  EXPECT_EQ(tiny.values(),
            (std::vector<double>{0.0583, 0.0325, 8.8e-5, 0.0055, 0.0271, 4.62e-5, 0.062}));
  EXPECT_EQ(tiny.body.input_max, 1.0);
  const Model mvwt = loadModel("cfg/hovercraft/mvwt.yaml");
  EXPECT_EQ(mvwt.values(), (std::vector<double>{5.15, 0.123, 0.047, 4.5, 4.5, 0.41, 1.0}));
  EXPECT_EQ(mvwt.body.input_max, 4.5);
}

TEST(ModelFile, ReadsEffects) {
  const Model model = parseModel(kGood, "good");
  ASSERT_EQ(model.effects.size(), 3u);
  EXPECT_EQ(model.value("motor_lag.tau"), 0.05);
  EXPECT_EQ(model.value("washboard.a"), 0.01);
  EXPECT_EQ(model.stateCount(), 2);
  EXPECT_EQ(model.coordinates()[model.index("battery_sag.tau")], 0.0);
}

TEST(ModelFile, ComesBackAsItWasWritten) {
  Model model = parseModel(kGood, "good");
  model.setValue("k", 0.0612345678901234);
  model.provenance.date = "2026-01-02T03:04:05Z";
  model.provenance.command = "identify fit \"a b.bag\"";
  model.provenance.bags = {"a b.bag", "c.bag"};
  model.provenance.error_before = {{"fit", 0.9}, {"heldout", 1.0}};
  model.provenance.error_after = {{"fit", 0.5}};
  model.provenance.confidence_95 = {
      {"k", {0.06, 0.063}}, {"battery_sag.tau", {80, std::numeric_limits<double>::infinity()}}};
  const std::string text = formatModel(model);
  const Model back = parseModel(text, "written");
  EXPECT_EQ(back.name, model.name);
  EXPECT_EQ(back.values(), model.values());
  EXPECT_EQ(back.body.input_max, model.body.input_max);
  EXPECT_EQ(formatModel(back), text);
  EXPECT_EQ(back.provenance.confidence_95, model.provenance.confidence_95);
  EXPECT_NE(text.find("# s, time constant"), std::string::npos) << text;

  RigidState<double> state;
  state.eta << 0.2, 0, 0.7;
  const auto force = [&](const Model& m) {
    return Dynamics<double>(m).derivative(0, state, {0, 0}, 1).nu;
  };
  EXPECT_EQ(force(back), force(model));
}

struct Bad {
  const char *from, *to, *says;
};

TEST(ModelFile, ComplaintsNameLineKeyAndRange) {
  const Bad cases[] = {
      {"N_r: 3.0e-5, ", "", "line 3: body lacks N_r"},
      {"N_r: 3.0e-5", "N_r: -1", "line 3: N_r = -1 N m s is outside [0, inf)"},
      {"N_r: 3.0e-5", "N_r: .nan", "line 3: N_r must not be NaN"},
      {"N_r: 3.0e-5", "N_r: .inf", "N_r = inf N m s is outside [0, inf)"},
      {"N_r: 3.0e-5", "N_r: much", "N_r must be a number"},
      {"m: 0.06", "m: 0", "m = 0 kg is outside (0, inf)"},
      {"m: 0.06", "m: 0.06, m: 0.07", "key 'm' comes twice"},
      {"m: 0.06", "m: 0.06, mass: 1", "unknown key 'mass' in body; allowed are m, l,"},
      {"input_max: 1", "input_max: 0", "input_max = 0"},
      {", input_max: 1", "", "lacks input_max"},
      {"tau: 0.05", "tau: 5", "line 6: tau = 5 s is outside [0, 2]"},
      {"tau: 0.05", "tua: 0.05", "line 6: unknown key 'tua' in effect motor_lag; allowed are tau"},
      {"    tau: 0.05\n", "", "line 5: effect motor_lag lacks tau"},
      {"motor_lag", "motor_lug", "line 5: unknown effect 'motor_lug'; known are added_mass"},
      {"battery_sag", "motor_lag", "has effect 'motor_lag' already"},
      {"sin(2*pi*x/w)*cos", "sin(2*pi*x/w*cos", "formula X"},
      {"unit: N, ", "", "line 12: parameter a lacks its unit"},
      {"value: 0.01", "value: 2", "line 12: a = 2 N is outside [-1, 1]"},
      {"schema: ground/model/1", "schema: ground/model/9", "not a model file"},
      {"name: test", "nam: test", "unknown key 'nam' in the model file"},
      {"name: test", "name: [", "craft.yaml, line"},
      {"effects:\n", "effects: 3\nother:\n", "craft.yaml, line"},
  };
  ASSERT_EQ(complaint(kGood), "");
  for (const Bad& bad : cases) {
    const std::string said = complaint(replaced(bad.from, bad.to));
    EXPECT_NE(said.find(bad.says), std::string::npos) << bad.to << " gave: " << said;
    EXPECT_EQ(said.find("craft.yaml"), 0u) << said;
  }
  EXPECT_NE(complaint(""), "");
  EXPECT_NE(complaint("[1, 2]"), "");
  EXPECT_THROW(loadModel("no/such/model.yaml"), std::runtime_error);
}

TEST(ModelFile, IsNeverOverwrittenUnlessAllowed) {
  char folder[] = "/tmp/ground_model_file_XXXXXX";
  ASSERT_NE(mkdtemp(folder), nullptr);
  const std::string path = std::string(folder) + "/model.yaml";
  Model model = parseModel(kGood, "good");
  saveModel(model, path);
  model.setValue("k", 0.05);
  EXPECT_THROW(saveModel(model, path), std::runtime_error);
  EXPECT_EQ(loadModel(path).value("k"), 0.06);
  saveModel(model, path, true);
  EXPECT_EQ(loadModel(path).value("k"), 0.05);
  EXPECT_THROW(saveModel(model, std::string(folder) + "/none/model.yaml"), std::runtime_error);
  int files = 0;
  for ([[maybe_unused]] const auto& entry : std::filesystem::directory_iterator(folder)) ++files;
  EXPECT_EQ(files, 1) << "a temporary file is left behind";
  std::filesystem::remove_all(folder);
}

TEST(ModelFile, IsWrittenAndNotOverwrittenWhereThereAreNoHardLinks) {
  char folder[] = "/tmp/ground_model_file_XXXXXX";
  ASSERT_NE(mkdtemp(folder), nullptr);
  const std::string path = std::string(folder) + "/model.yaml";
  Model model = parseModel(kGood, "good");
  link_fails = true;
  EXPECT_NO_THROW(saveModel(model, path));
  model.setValue("k", 0.05);
  EXPECT_THROW(saveModel(model, path), std::runtime_error);
  link_fails = false;
  EXPECT_EQ(loadModel(path).value("k"), 0.06);
  int files = 0;
  for ([[maybe_unused]] const auto& entry : std::filesystem::directory_iterator(folder)) ++files;
  EXPECT_EQ(files, 1) << "a temporary file is left behind";
  std::filesystem::remove_all(folder);
}

TEST(Model, RefusesBadValuesAndKeepsTheOldOnes) {
  Model model = parseModel(kGood, "good");
  EXPECT_THROW(model.setValue("k", -1), std::invalid_argument);
  EXPECT_THROW(model.setValue("motor_lag.tau", 3), std::invalid_argument);
  EXPECT_THROW(model.setValue("nothing", 3), std::invalid_argument);
  EXPECT_EQ(model.values(), parseModel(kGood, "good").values());
  model.removeEffect("motor_lag");
  EXPECT_FALSE(model.hasEffect("motor_lag"));
  EXPECT_THROW(model.removeEffect("motor_lag"), std::invalid_argument);
}

}  // namespace
}  // namespace ground

int main(int argc, char** argv) {
  testing::InitGoogleTest(&argc, argv);
  return RUN_ALL_TESTS();
}
