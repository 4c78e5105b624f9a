// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <map>
#include <string>
#include <utility>
#include <vector>

namespace citylearn {

/// A request for the API, as the server hands it on: authorised, decoded, within limits.
struct Query {
  std::string method = "GET";                     ///< "GET", "DELETE"
  std::vector<std::string> path;                  ///< segments behind /api/, percent-decoded: {"runs", ID, "training"}
  std::map<std::string, std::string> parameters;  ///< of the query string, percent-decoded
};

/// What the API answers.
struct Answer {
  int status = 200;
  std::string type = "application/json";
  std::string body;
  std::vector<std::pair<std::string, std::string>> headers;  ///< further ones: {"Retry-After", "1"}
};

/// An error as the API tells it: {"error": what}.
Answer error_answer(int status, const std::string& what);

}  // namespace citylearn
