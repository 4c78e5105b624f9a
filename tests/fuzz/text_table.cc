// SPDX-License-Identifier: Apache-2.0
#include "env_service/files/text_table.h"

#include <cmath>
#include <fstream>

#include "tests/fuzz/targets.h"
#include "tests/support/processes/service.h"

namespace citylearn::fuzz {

bool text_table(Input input) {
  static const testing::Folder folder;
  if (input.empty()) return false;
  const auto choice = std::to_integer<unsigned>(input[0]);
  TextTable::Options options;
  options.separator = std::string_view(", ;\t")[choice % 4];
  options.header = (choice / 4) % 2 == 0;
  const std::string path = folder / "x.txt";
  {
    std::ofstream file(path, std::ios::binary);
    file.write(reinterpret_cast<const char*>(input.data() + 1), static_cast<std::streamsize>(input.size() - 1));
  }
  return accepted([&] {
    const TextTable table(path, options);
    require(table.rows() >= 0 && static_cast<std::size_t>(table.rows()) <= input.size(), "rows");
    for (int row = 0; row < table.rows(); ++row) {
      require(table.columns(row) >= 1, "a row has a field");
      for (int column = 0; column < table.columns(row); ++column) {
        const std::string_view text = table.text(row, column);
        require(text.find_first_of("\r\n") == text.npos, "a field is within its line");
        accepted([&] { require(std::isfinite(table.number(row, column)), "numbers are finite"); });
      }
      const bool named = accepted([&] { table.number(row, "lat"); });
      require(!named || table.has("lat"), "a column by its name");
      require(!accepted([&] { table.text(row, table.columns(row)); }), "there is no such column");
      require(!accepted([&] { table.fail(row, "wrong"); }), "an Error");
    }
  });
}

}  // namespace citylearn::fuzz
