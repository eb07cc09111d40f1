#include "certificate.h"

#include <algorithm>
#include <cmath>
#include <vector>

#include "../document/document.h"
#include "../document/json.h"
#include "../document/numbers.h"

namespace kincal {
namespace {

constexpr char kStyle[] =
    "@page{size:A4;margin:16mm}"
    "body{font:10.5pt/1.45 'Liberation Sans',Arial,sans-serif;color:#1a1a1a;max-width:178mm;"
    "margin:12mm auto;padding:0 4mm}"
    "h1{font-size:21pt;margin:0;font-weight:600}h2{font-size:12pt;margin:6mm 0 1.5mm;"
    "border-bottom:.4mm solid #1a1a1a;break-after:avoid}"
    "p{margin:1.5mm 0}table{border-collapse:collapse;width:100%}"
    "td,th{padding:.8mm 2mm .8mm 0;text-align:left;vertical-align:top;font-weight:400}"
    "tr+tr>*{border-top:.15mm solid #bbb}thead th{font-weight:600}"
    ".n{text-align:right;font-variant-numeric:tabular-nums;white-space:nowrap}"
    ".answer{border:.6mm solid;padding:3mm 5mm;margin:5mm 0}"
    ".answer b{font-size:17pt;display:block;text-transform:uppercase;letter-spacing:.05em}"
    ".pass{color:#14602c}.fail{color:#9c1c1c}.not{color:#7a5200}.none{color:#333}"
    ".hash{font:7.5pt 'Liberation Mono',monospace;word-break:break-all}"
    ".sign td{height:14mm;border-bottom:.2mm solid #1a1a1a;vertical-align:bottom}"
    "th{white-space:nowrap}svg{margin-top:5mm}svg text{font:3px 'Liberation Sans',Arial,sans-serif}"
    ".page{break-before:page}"
    "@media print{body{margin:0;padding:0;max-width:none}}";

std::string html(const std::string& words) {
  std::string out;
  for (const char c : words)
    out += c == '&'   ? "&amp;"
           : c == '<' ? "&lt;"
           : c == '>' ? "&gt;"
           : c == '"' ? "&quot;"
                      : std::string(1, c);
  return out;
}

bool is_absent(const Field& field) { return field.node->kind == Node::Kind::null; }

/// A number times a factor with 4 digits; a dash for none.
std::string figure(const Field& field, double factor = 1000) {
  return is_absent(field) ? "–" : rounded(factor * field.number(), 4);
}

std::string words_or_dash(const Field& field) {
  return is_absent(field) ? "not stated" : html(field.string());
}

std::string entry(const std::string& name, const std::string& value) {
  return "<tr><th>" + name + "</th><td>" + value + "</td></tr>\n";
}

/// A row of the table of figures.
std::string figure_row(const std::string& name, const Field& before, const Field& after) {
  const bool limits = after.has("lower");
  return "<tr><th>" + name + "</th><td class=n>" + figure(before["rms"]) + "</td><td class=n>" +
         figure(after["rms"]) + "</td><td class=n>" +
         (limits ? figure(after["lower"]) + " to " + figure(after["upper"]) : "–") +
         "</td><td class=n>" + figure(after["seen"]) + "</td><td class=n>" + figure(after["max"]) +
         "</td></tr>\n";
}

std::string figures_table(const Field& all) {
  const Field before = all["before"], after = all["after"];
  std::string out =
      "<table><thead><tr><th>Root mean square error</th><th class=n>before</th><th class=n>after"
      "</th><th class=n>limits (k = 2)</th><th class=n>as seen</th><th "
      "class=n>largest</th></tr></thead>\n";
  out += figure_row("distances between postures, mm", before["distance"], after["distance"]);
  out += figure_row("positions, mm", before["position"], after["position"]);
  if (after.has("rotation"))
    out += figure_row("orientations, mrad", before["rotation"], after["rotation"]);
  return out + "</table>\n";
}

std::string repeated_table(const Field& repeated) {
  constexpr size_t kShown = 8;
  if (repeated.size() == 0) return "";
  std::string out =
      "<h2>Postures that were repeated (ISO 9283)</h2>\n<table><thead><tr><th>posture</th>"
      "<th class=n>times</th><th class=n>accuracy AP, mm</th><th class=n>repeatability RP, mm</th>"
      "<th class=n>vAP, mm</th></tr></thead>\n";
  for (size_t i = 0; i < std::min(kShown, repeated.size()); ++i) {
    const Field one = repeated.item(i);
    out += "<tr><th>" + html(one["posture"].string()) + "</th><td class=n>" +
           figure(one["count"], 1) + "</td><td class=n>" + figure(one["ap"]) + " ± " +
           figure(one["ap_uncertainty"]) + "</td><td class=n>" + figure(one["rp"]) + " ± " +
           figure(one["rp_uncertainty"]) + "</td><td class=n>" +
           (one.has("vap") ? figure(one["vap"]) : "–") + "</td></tr>\n";
  }
  out += "</table>\n";
  if (repeated.size() > kShown)
    out +=
        "<p>" + std::to_string(repeated.size() - kShown) + " more are in certificate.json.</p>\n";
  return out;
}

/// A histogram of position errors, before behind after.
std::string histogram(const Field& postures) {
  constexpr int kBins = 24;
  constexpr double kWidth = 170, kHeight = 38;
  std::vector<double> after, before;
  for (size_t i = 0; i < postures.size(); ++i) {
    after.push_back(postures.item(i)["error"].number());
    before.push_back(postures.item(i)["before"].number());
  }
  double most = 0;
  for (const double e : after) most = std::max(most, e);
  for (const double e : before) most = std::max(most, e);
  if (!(most > 0)) return "";
  const auto counts = [&](const std::vector<double>& errors) {
    std::vector<int> out(kBins, 0);
    for (const double e : errors) ++out[std::min(kBins - 1, static_cast<int>(e / most * kBins))];
    return out;
  };
  const std::vector<int> a = counts(after), b = counts(before);
  const int highest =
      std::max(*std::max_element(a.begin(), a.end()), *std::max_element(b.begin(), b.end()));
  std::string out = "<svg viewBox=\"0 0 170 46\" role=img aria-label=\"Position errors\">\n";
  const auto bars = [&](const std::vector<int>& of, double inset, const std::string& fill) {
    for (int k = 0; k < kBins; ++k) {
      if (of[k] == 0) continue;
      const double h = kHeight * of[k] / highest;
      out += "<rect x=\"" + rounded(k * kWidth / kBins + inset, 5) + "\" y=\"" +
             rounded(kHeight - h, 5) + "\" width=\"" + rounded(kWidth / kBins - 2 * inset, 5) +
             "\" height=\"" + rounded(h, 5) + "\" fill=\"" + fill + "\"/>\n";
    }
  };
  bars(b, 0.3, "#c9c9c9");
  bars(a, 1.6, "#1f5f8b");
  out += "<path d=\"M0 38H170\" stroke=\"#1a1a1a\" stroke-width=\".3\"/>\n";
  for (int k = 0; k <= 4; ++k)
    out += "<text x=\"" + rounded(kWidth * k / 4, 5) + "\" y=\"42.5\" text-anchor=\"" +
           (k == 0   ? "start"
            : k == 4 ? "end"
                     : "middle") +
           "\">" + rounded(1000 * most * k / 4, 3) + "</text>\n";
  return out +
         "</svg>\n<p>Position errors of the postures, mm: before (grey) and after (blue).</p>\n";
}

std::string statement(const Field& all) {
  const Field position = all["after"]["position"], distance = all["after"]["distance"],
              instrument = all["instrument"];
  std::string out =
      "<h2>Statement of uncertainty</h2>\n<p>All limits are for a coverage factor k = 2 (about 95 "
      "% of cases between them). They account for the sample size (" +
      figure(all["counts"]["postures"], 1) + " postures; effective degrees of freedom " +
      rounded(distance["freedom"].number(), 3) + " of distances, " +
      rounded(position["freedom"].number(), 3) +
      " of positions), the noise of the instrument (rms " + figure(distance["instrument"]) +
      " mm of a distance, " + figure(position["instrument"]) +
      " mm of a position, subtracted from the figures above), and the uncertainty of this noise (" +
      rounded(100 * instrument["known"].number(), 2) +
      " %). The largest errors, and those as seen, contain the instrument's noise.</p>\n";
  if (!is_absent(instrument["base_sigma"]))
    out +=
        "<p>Positions are relative to the instrument at its calibrated pose. Relative to the "
        "robot's base link the uncertainty of that pose is " +
        figure(instrument["base_sigma"]) +
        " mm (k = 1), which is not in the limits: no measurement here is of the base link.</p>\n";
  out +=
      "<p>Decision rule (ISO 14253-1): <em>pass</em> where the upper limit is below the tolerance, "
      "<em>fail</em> where the lower limit is above it, else <em>not provable</em>. It applies to "
      "postures distributed like the measured ones.";
  const Field tolerance = all["tolerance"];
  if (!is_absent(tolerance) && tolerance["of"].string() == "max")
    out +=
        " The limits of the largest error allow for the instrument's noise in every measurement; "
        "they are those of the measured postures.";
  out += "</p>\n<p>";
  out += "Before is the nominal robot; the instrument's pose is fitted to these samples for it. ";
  const Field fitted = instrument["refitted"];
  out += fitted.boolean()
             ? "After, it is fitted likewise; the six fitted components are accounted for.</p>\n"
             : "After, it is that of the calibration.</p>\n";
  const Field notes = all["notes"];
  for (size_t i = 0; i < notes.size(); ++i)
    out += "<p>Note: " + html(notes.item(i).string()) + ".</p>\n";
  return out;
}

/// The answer without the word that stands above it.
std::string answer_sentence(const Field& all) {
  const std::string answer = all["answer"].string() + ": ", sentence = all["text"].string();
  return sentence.rfind(answer, 0) == 0 ? sentence.substr(answer.size()) : sentence;
}

std::string about(const Field& all) {
  const Field instrument = all["instrument"], dates = all["dates"];
  std::string out = "<table>\n";
  out += entry("Robot", html(all["robot"]["name"].string()) +
                            ", serial number: " + words_or_dash(all["robot"]["serial"]));
  out += entry("Verified frame", html(instrument["frame"].string()));
  out += entry("Instrument", words_or_dash(instrument["name"]) + " (sensor " +
                                 html(instrument["sensor"].string()) + " on target " +
                                 html(instrument["target"].string()) + "); standard uncertainty " +
                                 figure(instrument["sigma"]) + " mm of a position");
  out += entry("Environment", words_or_dash(all["environment"]));
  out += entry("Calibrated", words_or_dash(dates["calibrated"]));
  out += entry("Measured", words_or_dash(dates["measured"]));
  out += entry("Issued", html(dates["issued"].string()));
  const std::string standard = all["standard"].string();
  out += entry("Standard", standard == "distances"
                               ? "distances between any two postures (after ISO 9283, AD)"
                               : "positions relative to the instrument (after ISO 9283, AP)");
  out += entry("Samples", figure(all["counts"]["postures"], 1) + " postures, " +
                              figure(all["counts"]["views"], 1) +
                              " views that the calibration has not seen");
  return out + "</table>\n";
}

}  // namespace

std::string certificate_page(const std::string& certificate_json) {
  const std::string path = "certificate.json";
  const Node node = parse_json(certificate_json, path);
  const Field all = top(node, path);
  const std::string answer = all["answer"].string();
  std::string out =
      "<!DOCTYPE html>\n<html lang=en><head><meta charset=utf-8><meta name=viewport "
      "content=\"width=device-width\"><title>Certificate of verification</title>\n<style>";
  out += kStyle;
  out +=
      "</style></head><body>\n<h1>Certificate of verification</h1>\n<p>Accuracy of a calibrated "
      "robot, on samples that its calibration has not seen</p>\n";
  out += about(all);
  out += "<div class=\"answer " + answer.substr(0, answer.find(' ')) + "\"><b>" +
         (answer == "none" ? "no tolerance" : html(answer)) + "</b>" + html(answer_sentence(all)) +
         "</div>\n";
  out += figures_table(all);
  out += histogram(all["postures"]);
  out += "<div class=page></div>\n";
  out += statement(all);
  out += repeated_table(all["repeated"]);
  out += "<h2>Files (SHA-256)</h2>\n<table class=hash>\n";
  const Field hashes = all["sha256"];
  for (const auto& [name, ignored] : hashes.members())
    out += entry(html(name), html(hashes[name].string()));
  out += "</table>\n<p class=hash>" + html(all["command"].string()) + " (kincal " +
         html(all["kincal"].string()) + ")</p>\n";
  out += "<table class=sign><tr><td>Date</td><td>Name</td><td>Signature</td></tr></table>\n";
  return out + "</body></html>\n";
}

}  // namespace kincal
