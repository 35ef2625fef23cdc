// SPDX-License-Identifier: Apache-2.0
#include "toolchain/session/page.hpp"

#include "toolchain/page/assets.hpp"
#include "toolchain/support/escape.hpp"

namespace holdfast::tool::page {

namespace {

std::string head(std::string_view title, std::string_view rules) {
  std::string out = "<!doctype html>\n<html lang=\"en\"><head><meta charset=\"utf-8\"/>";
  out += R"(<meta name="viewport" content="width=device-width,initial-scale=1"/>)";
  out += R"(<meta http-equiv="Content-Security-Policy" content="default-src 'none'; script-src 'unsafe-inline'; )"
         R"(style-src 'unsafe-inline'; img-src blob:)";
  out += std::string(rules) + "\"/>";
  out += "<title>" + escape(title) + "</title><style>";
  out += style_text();
  return out + "</style></head>\n<body><main>\n";
}

}  // namespace

std::string begin(std::string_view title) {
  return head(title, "");
}

std::string explorer() {
  return std::string(explorer_text());
}

std::string end(const std::string& data) {
  std::string out = "</main>\n<script type=\"application/json\" id=\"data\">" + data + "</script>\n<script>\n";
  out += script_text();
  return out + "</script></body></html>\n";
}

std::string live(bool served) {
  return head("Holdfast live", served ? "; connect-src 'self'" : "") +
         "<header><h1>Holdfast live</h1><p class=\"sub\">What the sensor sees and decides, straight from the board's "
         "port</p></header>\n<noscript><p>This page shows a live session only, and needs its script for "
         "that.</p></noscript>\n" +
         "<div class=\"watch\">\n" + explorer() + "</div>\n" + end(served ? "{\"served\":true}" : "null");
}

}  // namespace holdfast::tool::page
