// SPDX-License-Identifier: Apache-2.0
#include "dashboard/http/answer.h"

#include <nlohmann/json.hpp>

namespace citylearn {

Answer error_answer(int status, const std::string& what) {
  Answer answer;
  answer.status = status;
  // What people and files wrote may be no UTF-8.
  answer.body = nlohmann::json{{"error", what}}.dump(-1, ' ', false, nlohmann::json::error_handler_t::replace);
  return answer;
}

}  // namespace citylearn
