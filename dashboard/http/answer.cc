// SPDX-License-Identifier: Apache-2.0
#include "dashboard/http/answer.h"

#include <nlohmann/json.hpp>

namespace citylearn {

std::string text_of(const nlohmann::json& json) {
  return json.dump(-1, ' ', false, nlohmann::json::error_handler_t::replace);
}

Answer json_answer(const nlohmann::json& json) {
  Answer answer;
  answer.body = text_of(json);
  return answer;
}

Answer error_answer(int status, const std::string& what) {
  Answer answer = json_answer({{"error", what}});
  answer.status = status;
  return answer;
}

}  // namespace citylearn
