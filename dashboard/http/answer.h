// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <map>
#include <nlohmann/json_fwd.hpp>
#include <string>
#include <utility>
#include <vector>

namespace citylearn {

/// A request to the API, as the server passes it on: authorised, decoded, within limits.
struct Query {
  std::string method = "GET";                     ///< "GET", "DELETE"
  std::vector<std::string> path;                  ///< segments behind /api/, percent-decoded: {"runs", ID, "training"}
  std::map<std::string, std::string> parameters;  ///< of the query string, percent-decoded
};

/// An answer of the API.
struct Answer {
  int status = 200;
  std::string type = "application/json";
  std::string body;
  std::vector<std::pair<std::string, std::string>> headers;  ///< further ones: {"Retry-After", "1"}
};

/// Returns the text of `json`, in which what is not UTF-8 is replaced: names and messages from elsewhere may hold any.
std::string text_of(const nlohmann::json& json);

/// Returns an answer of JSON.
Answer json_answer(const nlohmann::json& json);
/// Returns an error of the API: {"error": what}.
Answer error_answer(int status, const std::string& what);

}  // namespace citylearn
