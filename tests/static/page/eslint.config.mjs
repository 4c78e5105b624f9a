// SPDX-License-Identifier: Apache-2.0
// The rules for the page's sources: those that know types, which find promises that nobody awaits and conditions that are
// always true. run.sh starts eslint in dashboard/web.
import tseslint from 'typescript-eslint';

export default tseslint.config(...tseslint.configs.recommendedTypeChecked, {
  languageOptions: { parserOptions: { projectService: true, tsconfigRootDir: process.cwd() } },
  linterOptions: { reportUnusedDisableDirectives: 'error' },
  rules: {
    '@typescript-eslint/no-unused-vars': ['error', { argsIgnorePattern: '^_', varsIgnorePattern: '^_' }],
  },
});
