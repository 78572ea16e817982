// Model files: strict reading, round trip.
#include "ground/model/model_file.h"

#include <gtest/gtest.h>

#include <cmath>
#include <fstream>
#include <limits>
#include <random>

#include "../crafts.h"
#include "ground/model/expression_effect.h"
#include "ground/model/plausibility.h"
#include "ground/model/shortened.h"
#include "ground/model/simulation.h"

namespace ground {
namespace model_file_test {

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
  return refusal([&] { parseModel(yaml, "craft.yaml"); });
}

TEST(ModelFile, ReadsTheShippedCrafts) {
  const Model tiny = loadModel("cfg/hovercraft/tiny_whoover.yaml");
  EXPECT_EQ(tiny.values(), (std::vector<double>{0.0583, 0.0325, 8.8e-5, 0.0055, 0.0271, 4.62e-5, 0.062}));
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

TEST(ModelFile, RoundTrip) {
  Model model = parseModel(kGood, "good");
  model.setValue("k", 0.0612345678901234);
  model.provenance.date = "2026-01-02T03:04:05Z";
  model.provenance.command = "identify fit \"a b.bag\"";
  model.provenance.bags = {"a b.bag", "c.bag"};
  model.provenance.digests = {"0a1b", "2c3d"};
  model.provenance.error_before = {{"fit", 0.9}, {"heldout", 1.0}};
  model.provenance.error_after = {{"fit", 0.5}};
  model.provenance.confidence_95 = {{"k", {0.06, 0.063}},
                                    {"battery_sag.tau", {80, std::numeric_limits<double>::infinity()}}};
  model.provenance.not_identified = {"m", "battery_sag.tau"};
  const std::string text = formatModel(model);
  const Model back = parseModel(text, "written");
  EXPECT_EQ(back.name, model.name);
  EXPECT_EQ(back.values(), model.values());
  EXPECT_EQ(back.body.input_max, model.body.input_max);
  EXPECT_EQ(formatModel(back), text);
  EXPECT_EQ(back.provenance.confidence_95, model.provenance.confidence_95);
  EXPECT_EQ(back.provenance.date, model.provenance.date);
  EXPECT_EQ(back.provenance.command, model.provenance.command);
  EXPECT_EQ(back.provenance.bags, model.provenance.bags);
  EXPECT_EQ(back.provenance.digests, model.provenance.digests);
  EXPECT_EQ(back.provenance.error_before, model.provenance.error_before);
  EXPECT_EQ(back.provenance.error_after, model.provenance.error_after);
  EXPECT_EQ(back.provenance.not_identified, model.provenance.not_identified);
  EXPECT_NE(text.find("# s, time constant"), std::string::npos) << text;

  RigidState<double> state;
  state.eta << 0.2, 0, 0.7;
  const auto force = [&](const Model& m) {
    return Dynamics<double>(m).derivative(0, state, {0, 0}, {1, std::nullopt}).nu;
  };
  EXPECT_EQ(force(back), force(model));
}

struct Bad {
  const char *from, *to, *expected;
};

TEST(ModelFile, ComplaintsNameLineKeyAndRange) {
  const Bad cases[] = {
      {"N_r: 3.0e-5, ", "", "line 3: body has no N_r"},
      {"N_r: 3.0e-5", "N_r: -1", "line 3: N_r = -1 N m s is outside [0, inf)"},
      {"N_r: 3.0e-5", "N_r: .nan", "line 3: N_r must not be NaN"},
      {"N_r: 3.0e-5", "N_r: .inf", "N_r = inf N m s is outside [0, inf)"},
      {"N_r: 3.0e-5", "N_r: much", "N_r must be a number"},
      {"m: 0.06", "m: 0", "m = 0 kg is outside (0, inf)"},
      {"m: 0.06", "m: 0.06, m: 0.07", "duplicate key 'm'"},
      {"m: 0.06", "m: 0.06, mass: 1", "unknown key 'mass' in body; allowed are m, l,"},
      {"input_max: 1", "input_max: 0", "input_max = 0"},
      {", input_max: 1", "", "has no input_max"},
      {"tau: 0.05", "tau: 5", "line 6: tau = 5 s is outside [0, 2]"},
      {"tau: 0.05", "tua: 0.05",
       "line 6: unknown key 'tua' in effect motor_lag (did you mean 'tau'?); allowed are name, tau"},
      {"    tau: 0.05\n", "", "line 5: effect motor_lag has no tau"},
      {"motor_lag", "motor_lug",
       "line 5: unknown effect 'motor_lug' (did you mean 'motor_lag'?); known are added_mass"},
      {"battery_sag", "motor_lag", "has effect 'motor_lag' already"},
      {"sin(2*pi*x/w)*cos", "sin(2*pi*x/w*cos", "formula X"},
      {"unit: N, ", "", "line 12: parameter a has no unit"},
      {"value: 0.01", "value: 2", "line 12: a = 2 N is outside [-1, 1]"},
      {"schema: ground/model/1", "schema: ground/model/9", "not a model file"},
      {"name: test", "nam: test", "unknown key 'nam' in the model file"},
      {"name: test", "name: [", "craft.yaml, line"},
      {"effects:\n", "effects: 3\nother:\n", "craft.yaml, line"},
      {"body: {m: 0.06, l: 0.03, I_z: 1.0e-4, X_u: 0.01, Y_v: 0.02, N_r: 3.0e-5, k: 0.06, "
       "input_max: 1}",
       "body: 3", "line 3: body must be a map of key: value"},
      {"scale: 0.02", "scale: 0", "line 12: scale must be positive"},
      {"scale: 0.02", "scale: .inf", "line 12: scale must be positive"},
      {"scale: 0.02", "skale: 0.02", "line 12: unknown key 'skale' in parameter a"},
      {"{value: 0.01, ", "{", "line 12: parameter a has no value"},
      {"neutral: 0.3, lower: 0.1", "neutral: 0.05, lower: 0.1",
       "line 13: neutral value of w = 0.05 m is outside [0.1, 1]"},
      {"effects:\n", "provenance: {bags: 3}\neffects:\n", "line 4: bags must be a list"},
      {"effects:\n", "provenance: {bags: [a, b], digests: [c]}\neffects:\n",
       "line 4: provenance must have one digest for each of its bags, or none"},
      {"effects:\n", "provenance: {confidence_95: {k: 3}}\neffects:\n",
       "line 4: k must be a list of 2 numbers"},
      {"effects:\n", "provenance: {confidence_95: {k: [1, 2, 3]}}\neffects:\n",
       "line 4: k must be a list of 2 numbers"},
      {"effects:\n", "provenance: {not_identified: 3}\neffects:\n", "line 4: not_identified must be a list"},
      {"effects:\n", "provenance: {bag: [a]}\neffects:\n", "line 4: unknown key 'bag' in provenance"},
  };
  ASSERT_EQ(complaint(kGood), "");
  for (const Bad& bad : cases) {
    const std::string message = complaint(replaced(bad.from, bad.to));
    EXPECT_NE(message.find(bad.expected), std::string::npos) << bad.to << " gave: " << message;
    EXPECT_EQ(message.find("craft.yaml"), 0u) << message;
  }
  EXPECT_EQ(complaint("# nothing\n"), "craft.yaml: it is empty");
  EXPECT_NE(complaint("[1, 2]"), "");
  EXPECT_THROW(loadModel("no/such/model.yaml"), std::runtime_error);
}

TEST(ModelFile, AnEffectFromAFileIsAddedOrRefusedWithItsLine) {
  const std::string gust =
      "name: gust\nexpression: {X: \"g*u\"}\nparameters:\n  g: {value: 0.1, unit: N s/m}\n";
  const Model model = withEffect(parseModel(kGood, "good"), gust, "own.yaml");
  EXPECT_EQ(model.effects.size(), 4u);
  EXPECT_EQ(model.value("gust.g"), 0.1);
  EXPECT_EQ(withEffect(Model(), "- name: motor_lag\n  tau: 0.1\n", "own.yaml").effects.size(), 1u);
  const Bad cases[] = {
      {"g: {value: 0.1, unit: N s/m}", "g: {value: much, unit: N s/m}", "own.yaml, line 4: g must be"},
      {"g*u", "g*(u", "own.yaml, line 1: effect 'gust': formula X = 'g*(u'"},
      {"parameters:\n", "parameter:\n", "own.yaml, line 4: unknown key 'parameter'"},
      {"name: gust", "name: washboard", "own.yaml, line 1: the model has effect 'washboard' already"},
      {"name: gust", "name: [", "own.yaml, line "},
      {gust.c_str(), "", "own.yaml: it is empty"},
      {gust.c_str(), kGood, "own.yaml, line 1: it must be one effect with a name"},
      {gust.c_str(), "name: motor_lug\n", "own.yaml, line 1: unknown effect 'motor_lug'"},
  };
  for (const Bad& bad : cases) {
    std::string text = gust;
    text.replace(text.find(bad.from), std::string(bad.from).size(), bad.to);
    const std::string message = refusal([&] { withEffect(parseModel(kGood, "good"), text, "own.yaml"); });
    EXPECT_EQ(message.find(bad.expected), 0u) << bad.to << ": " << message;
  }
}

/// `count` terms, each of 12 characters.
std::string sines(int count, const std::string& end = "") {
  std::string sum = "a*u";
  for (int i = 0; i < count; ++i) sum += "+a*sin(" + std::to_string(1000 + i) + "*u)";
  return sum + end;
}

std::string effectText(const std::string& name, const std::string& formula) {
  return "  - name: " + name + "\n    expression: {X: \"" + formula +
         "\"}\n    parameters: {a: {value: 0.01, unit: N}}\n";
}

TEST(ModelFile, NumbersAreWrittenExactlyAndAsShortAsPossible) {
  std::mt19937_64 random(1);
  std::uniform_real_distribution<double> mantissa(1, 10);
  Model model = parseModel(kGood, "good");
  for (int i = 0; i < 200; ++i) {
    const double value = mantissa(random) * std::pow(10, i % 30 - 20);
    model.setValue("N_r", value);
    EXPECT_EQ(parseModel(formatModel(model), "written").value("N_r"), value);
  }
  for (const char* text : {"0.1", "0.3", "1e-05", "123456", "0.000123456", "2.5e-07"}) {
    model.setValue("N_r", std::stod(text));
    EXPECT_NE(formatModel(model).find(std::string("N_r: ") + text + "  #"), std::string::npos)
        << formatModel(model);
  }
}

TEST(ModelFile, FormulasMayBeInTheFrameOfTheWorld) {
  const std::string spring = effectText("spring", "-a*x");
  const std::string world = std::string(kGood) + spring + "    frame: world\n";
  const std::string text = formatModel(parseModel(world, "world"));
  EXPECT_TRUE(expressionDefinition(*parseModel(text, "again").effects.back().effect)->world);
  EXPECT_EQ(formatModel(parseModel(text, "again")), text);
  EXPECT_EQ(complaint(std::string(kGood) + spring + "    frame: body\n"), "");
  EXPECT_NE(complaint(std::string(kGood) + spring + "    frame: room\n").find("frame must be"),
            std::string::npos);
}

TEST(ModelFile, HalfAConditionalIsRefused) {
  for (const char* formula : {"a*u:u", "-(a:u)", "+(a:u)", "sin(a:u)", "min(u, a:u)", "a*(u:v)", "u > (a:v)",
                              "u && (a:v)", "(a:u) ? a : u", "u ? (a:v) : a", "u ? a : (a:v)", "(a:u):(u:a)",
                              "u ? a", "u ? a ? v : a", "a ? u : v : a"}) {
    const std::string said = complaint(std::string(kGood) + effectText("gust", formula));
    EXPECT_NE(said.find(std::string("X = '") + formula + "': there is a"), std::string::npos) << said;
  }
  for (const char* formula :
       {"u > 0 ? a : -a", "a*(u > 0 ? v > 0 ? 1 : u : v)", "a*(u > 0 ? 1 : v > 0 ? 2 : u)"})
    EXPECT_EQ(complaint(std::string(kGood) + effectText("gust", formula)), "") << formula;
}

TEST(ModelFile, TellsAtWhichVoltageThrustHolds) {
  std::string text = kGood;
  text.replace(text.find(", input_max: 1"), 14, ", input_max: 1, volts: 7.4");
  const Model model = parseModel(text, "good");
  EXPECT_EQ(model.body.volts, 7.4);
  EXPECT_EQ(parseModel(formatModel(model), "written").body.volts, 7.4);
  EXPECT_EQ(formatModel(parseModel(kGood, "good")).find("volts"), std::string::npos);
  // Without a recorded voltage, a formula sees the one at which k holds.
  const std::string effect =
      "{name: weak, expression: {X: \"c * volt\"}, parameters: {c: {value: 0.01, unit: N/V, neutral: 0}}}";
  const Model with = withEffect(model, effect, "f");
  const auto surge = [&](std::optional<double> volts) {
    return Dynamics<double>(with).derivative(0, {}, {0, 0}, {1.0, volts}).nu.x() -
           Dynamics<double>(model).derivative(0, {}, {0, 0}, {1.0, volts}).nu.x();
  };
  EXPECT_NEAR(surge(std::nullopt), 0.074 / model.body.m, 1e-12);
  EXPECT_NEAR(surge(6), 0.06 / model.body.m, 1e-12);
  const std::string said = complaint(std::string(kGood) + "  - " + effect + "\n");
  EXPECT_NE(said.find("give body the key volts"), std::string::npos) << said;
}

TEST(ModelFile, EffectsAndFormulasHaveLimits) {
  std::string many = kGood;
  for (int i = 0; i < 2000; ++i) many += effectText("e" + std::to_string(i), "a*u");
  EXPECT_NE(complaint(many).find("a model has at most 64 effects"), std::string::npos);
  EXPECT_EQ(complaint(std::string(kGood) + effectText("gust", sines(60))), "");
  EXPECT_NE(complaint(std::string(kGood) + effectText("gust", sines(300)))
                .find("it is longer than 1000 characters"),
            std::string::npos);
  std::string parameters = "  - name: gust\n    expression: {X: \"a0*u\"}\n    parameters:\n";
  for (int i = 0; i < 40; ++i) parameters += "      a" + std::to_string(i) + ": {value: 0.01, unit: N}\n";
  EXPECT_NE(complaint(std::string(kGood) + parameters).find("more than 32 parameters"), std::string::npos);
}

TEST(Plausibility, SoundCraftsPassWithoutAWarning) {
  for (const char* craft : {"tiny_whoover", "tiny_whoover_4_1", "mvwt"}) {
    std::vector<std::string> warnings;
    loadModel(std::string("cfg/hovercraft/") + craft + ".yaml", &warnings);
    EXPECT_EQ(warnings, std::vector<std::string>()) << craft;
  }
  // Crafts of 0.02 to 50 kg: size grows with the cube root of the mass; lever, acceleration and
  // damping vary widely.
  for (double m : {0.02, 0.06, 0.18, 0.5, 1.5, 5.0, 15.0, 50.0}) {
    for (double lever : {0.3, 1.0, 3.0}) {
      for (double acceleration : {0.2, 2.0, 20.0}) {
        for (double damping : {0.0, 0.1, 1.0}) {
          for (double input_max : {0.8, 1.0, 20.0}) {
            const double gyration = 0.1 * std::cbrt(m);
            Body<double> b;
            b.m = m;
            b.l = lever * gyration;
            b.I_z = m * gyration * gyration;
            b.k = m * acceleration / 2 / input_max;
            b.X_u = 0.5 * m * damping;
            b.Y_v = m * damping;
            b.N_r = b.I_z * damping;
            b.input_max = input_max;
            for (const Implausibility& found : implausibilities(b)) ADD_FAILURE() << found.message;
          }
        }
      }
    }
  }
}

TEST(Plausibility, NamesKeyAndProbableUnit) {
  const struct {
    double Body<double>::*place;
    double value;
    const char *key, *expected;
  } cases[] = {
      {&Body<double>::m, 58.3, "m", "m: 58.3 kg is implausible"},
      {&Body<double>::m, 58.3, "m", "write 0.0583 kg if it is in g"},
      {&Body<double>::l, 3, "l", "write 0.03 m if it is in cm"},
      {&Body<double>::l, 32.5, "l", "write 0.0325 m if it is in mm"},
      {&Body<double>::I_z, 880, "I_z", "write 8.8e-05 kg m^2 if it is in g cm^2"},
      {&Body<double>::I_z, 0.88, "I_z", "write 8.8e-05 kg m^2 if it is in kg cm^2"},
      {&Body<double>::X_u, 5.5, "X_u", "write 0.0055 N s/m if it is in mN s/m"},
      {&Body<double>::Y_v, 27.1, "Y_v", "write 0.0271 N s/m if it is in mN s/m"},
      {&Body<double>::N_r, 0.0462, "N_r", "write 4.62e-05 N m s if it is in mN m s"},
      {&Body<double>::k, 62, "k", "write 0.062 N if it is in mN"},
      {&Body<double>::input_max, 100, "input_max", "write 1 if it is in per cent"},
  };
  for (const auto& bad : cases) {
    Body<double> body = tinyWhoover().body;
    body.*bad.place = bad.value;
    const auto found = implausibilities(body);
    ASSERT_EQ(found.size(), 1u) << bad.expected;
    EXPECT_EQ(found[0].key, bad.key);
    EXPECT_NE(found[0].message.find(bad.expected), std::string::npos) << found[0].message;
    EXPECT_FALSE(found[0].refused) << found[0].message;
  }
  Body<double> two = tinyWhoover().body;
  two.X_u *= 1000;
  two.N_r *= 1000;
  EXPECT_EQ(implausibilities(two).size(), 2u);
}

TEST(Plausibility, ACraftThatCannotMoveIsRefusedWithFileLineAndKey) {
  const std::string path = testing::TempDir() + "implausible.yaml";
  for (const Bad& bad :
       {Bad{"input_max: 1", "input_max: 1e-300", "input_max: 1e-300"},
        Bad{"m: 0.06", "m: 60000", "m: 6e+04 kg"}, Bad{"k: 0.06", "k: 1.0e+6", "k: 1e+06 N"}}) {
    std::ofstream(path) << replaced(bad.from, bad.to);
    const std::string message = refusal([&] { loadModel(path); });
    EXPECT_EQ(message.find(path + ", line 3: " + bad.expected), 0u) << message;
    EXPECT_NE(message.find("refused"), std::string::npos) << message;
    EXPECT_EQ(complaint(replaced(bad.from, bad.to)), "") << "models written by ground are read";
  }
  std::ofstream(path) << replaced("m: 0.06", "m: 60");
  std::vector<std::string> warnings;
  loadModel(path, &warnings);
  ASSERT_EQ(warnings.size(), 1u);
  EXPECT_EQ(warnings[0].find(path + ", line 3: m: 60 kg"), 0u) << warnings[0];
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

}  // namespace model_file_test
}  // namespace ground
